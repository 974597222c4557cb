"""Where the command line begins: `twincell`, or `python -m twincell`."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line. A Ctrl-C while it is still being loaded is one sentence too."""
    try:
        from .cli import main as run  # noqa: PLC0415 - loading takes a moment

        run()
    except KeyboardInterrupt:
        sys.stderr.write("stopped by Ctrl-C\n")
        raise SystemExit(1) from None
    except ImportError as error:
        if (error.name or "").split(".")[0] != "robot":
            raise
        sys.stderr.write(
            "another package named 'robot' (Robot Framework's?) hides twincell's own; "
            "install twincell into an environment of its own\n"
        )
        raise SystemExit(1) from None


if __name__ == "__main__":
    main()
