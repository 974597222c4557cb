"""`python -m twincell`."""

from .cli import main

main()
