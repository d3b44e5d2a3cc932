"""Renew the exact pins of everything that the project's environment holds (`constraint-dependencies` in pyproject.toml).

    python scripts/pin.py            # pin what `uv sync` has installed now
    python scripts/pin.py --newest   # let everything move to its newest version first

Only names and versions are written, no addresses.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).parents[1] / "pyproject.toml"


def uv(*words: str) -> str:
    """What a uv command prints."""
    return subprocess.run([sys.executable, "-m", "uv", *words], check=True, capture_output=True, text=True).stdout


def main() -> None:
    """Rewrite the list."""
    text = PROJECT.read_text()
    if "--newest" in sys.argv:
        PROJECT.write_text(re.sub(r"constraint-dependencies = \[.*?\]", "constraint-dependencies = []", text, flags=re.S))
        uv("sync", "--upgrade")
    exported = uv("export", "--no-hashes", "--no-annotate", "--no-header", "--no-emit-project", "--all-extras")
    pins = sorted(line.split("#")[0].strip() for line in exported.splitlines() if "==" in line)
    listed = "\n".join(f"  {json.dumps(pin)}," for pin in pins)
    PROJECT.write_text(
        re.sub(
            r"constraint-dependencies = \[.*?^\]|constraint-dependencies = \[\]",
            lambda _: f"constraint-dependencies = [\n{listed}\n]",
            text,
            flags=re.S | re.M,
        )
    )
    print(f"{len(pins)} packages pinned")


if __name__ == "__main__":
    main()
