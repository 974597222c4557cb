"""The twin engine: surface ⇄ toolpath.

What is public stands in `__init__.pyi`. A name is loaded when it is first used: all of them, with the libraries below
them, take seconds, and most programs need a few.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
