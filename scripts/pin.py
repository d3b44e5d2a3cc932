"""Renew the exact pins of all that the project's environment holds (`constraint-dependencies` in pyproject.toml).

    python scripts/pin.py            # pin what is resolved now
    python scripts/pin.py --newest   # let everything move to its newest version first

Only names and versions are written, no addresses.
"""

import json
import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).parents[1] / "pyproject.toml"
OPENING, CLOSING = "constraint-dependencies = [\n", "]  # end of the pins\n"


def main() -> None:
    """Rewrite the list between its two lines."""
    if "--newest" in sys.argv:
        _write([])
        _uv("lock", "--upgrade")
    wanted = ("--no-hashes", "--no-annotate", "--no-header", "--no-emit-project", "--all-extras")
    pins = sorted(line for line in _uv("export", *wanted).splitlines() if "==" in line)
    _write(pins)
    print(f"{len(pins)} packages pinned")


def _uv(*words: str) -> str:
    return subprocess.run([sys.executable, "-m", "uv", *words], check=True, capture_output=True, text=True).stdout


def _write(pins: list[str]) -> None:
    before, rest = PROJECT.read_text().split(OPENING)
    _, after = rest.split(CLOSING)
    listed = "".join(f"  {json.dumps(pin)},\n" for pin in pins)
    PROJECT.write_text(before + OPENING + listed + CLOSING + after)


if __name__ == "__main__":
    main()
