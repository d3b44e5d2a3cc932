"""The console script `sigmapoint`, and `python -m sigmapoint`."""

import os
import signal
import sys

INTERRUPTED = 130


def main() -> None:
    """Run the command line; say what is missing where its packages are not installed."""
    signal.signal(signal.SIGINT, _leave)
    try:
        from sigmapoint.cli import main as run
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("sigmapoint"):
            raise
        sys.exit(f"error: the command line needs {error.name}: pip install 'sigmapoint[cli]'")
    run()


def _leave(*_: object) -> None:
    """Ctrl-C while packages are imported: nothing is begun, and an exception could be lost inside an extension."""
    os.write(2, b"error: interrupted; nothing was begun\n")
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    main()
