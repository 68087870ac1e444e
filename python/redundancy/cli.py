"""Entry point of the command line; what it does is in `redundancy._commands`."""

import sys

__all__ = ["main"]

_EXTRA = {"typer", "rich", "matplotlib"}


def main() -> None:
    """Run `redundancy`; exit status 0 done, 1 the path cannot be followed, 2 bad input."""
    try:
        from redundancy._commands import run  # noqa: PLC0415 - the extra may be missing
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if missing not in _EXTRA:
            raise
        sys.stderr.write(f"redundancy: the command line needs '{missing}': pip install 'redundancy[cli]'\n")
        sys.exit(2)
    sys.exit(run())


if __name__ == "__main__":
    main()
