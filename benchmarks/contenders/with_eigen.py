"""The dense UKF of the turn in C++ with Eigen (Debian: libeigen3-dev), compiled on the spot for this machine.

The seconds are those of the filter alone, as the program takes them.
"""

import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from worker import serve

FLAGS = ["-O3", "-march=native", "-I/usr/include/eigen3"]


def _ukf(folder: Path) -> Any:
    program = folder / "ukf"

    def make(name: str, y: np.ndarray) -> Callable[[], Any]:
        if name != "turn":
            raise ValueError("only the turn is written in C++")
        if not program.exists():
            source = Path(__file__).parents[1] / "eigen" / "ukf.cpp"
            subprocess.run(["g++", *FLAGS, str(source), "-o", str(program)], check=True)
        data, means = folder / "y.bin", folder / "means.bin"
        y.tofile(data)

        def run() -> tuple[np.ndarray, float]:
            command = [str(program), str(data), str(len(y)), str(means)]
            shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
            return np.fromfile(means).reshape(len(y), -1), float(shown.split()[0])

        return run

    return make


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        serve(filter={"ukf": _ukf(Path(name))})
