"""The console script `sigmapoint`, and `python -m sigmapoint`."""

import sys


def main() -> None:
    """Run the command line; say what is missing where its packages are not installed."""
    try:
        from sigmapoint.cli import main as run
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("sigmapoint"):
            raise
        sys.exit(f"error: the command line needs {error.name}: pip install 'sigmapoint[cli]'")
    except KeyboardInterrupt:
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
