"""Look into a wheel, install it in an environment of its own, and let it do a small job there.

Usage: python .ci/check_wheel.py out/wheel/structsel-*.whl
"""

from __future__ import annotations

import json
import math
import random
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path, PurePosixPath

PACKAGE = Path(__file__).parents[1] / "structsel"
EXTRA = (".html", ".css", ".js", ".pyi", "py.typed")
LARGEST = 3 << 20  # bytes; code and templates alone are well below


def check_contents(wheel: Path) -> None:
    """Every module and template of the package is in the wheel, and nothing else is.

    Raises
    ------
    SystemExit
        Something is missing, or does not belong there.
    """
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if not name.endswith("/")}
    wanted = {
        str(PurePosixPath("structsel", path.relative_to(PACKAGE).as_posix()))
        for path in PACKAGE.rglob("*")
        if path.suffix == ".py" or path.name.endswith(EXTRA)
    }
    about = {name for name in held if name.split("/")[0].endswith(".dist-info")}
    complain("not in the wheel", wanted - held)
    complain("does not belong in the wheel", held - wanted - about)
    complain("no licence", set() if any("LICENSE" in name for name in about) else {wheel.name})
    complain(f"larger than {LARGEST} bytes", {wheel.name} if wheel.stat().st_size > LARGEST else set())
    print(f"{wheel.name}: {len(wanted)} files, {wheel.stat().st_size / 1024:.0f} KiB")


def check_use(wheel: Path, folder: Path) -> None:
    """Installed alone, the program says its version, reads a file and writes a model with its report.

    Raises
    ------
    CalledProcessError
        A step fails.
    """
    uv = (sys.executable, "-m", "uv")
    run(folder, *uv, "venv", "--quiet", "--python", sys.executable, "venv")
    programs = folder / "venv" / ("Scripts" if sys.platform == "win32" else "bin")
    run(folder, *uv, "pip", "install", "--quiet", "--python", programs / "python", wheel.resolve())
    version = run(folder, programs / "structsel", "--version")
    complain("another version", set() if version.split()[-1] in wheel.name else {version})
    (folder / "m01.csv").write_text(flight(), encoding="utf-8")
    run(
        folder, programs / "structsel", "select", "m01.csv", "--responses", "Cm", "--candidates", "alpha,de",
        "--bootstrap", "0", "--no-plots", "--out", "out",
    )  # fmt: skip
    model = json.loads((folder / "out" / "model.json").read_text(encoding="utf-8"))
    complain("other terms", set() if set(model["responses"]["Cm"]["terms"]) == {"1", "alpha", "de"} else {str(model)})
    complain(
        "no report", set() if "<script" in (folder / "out" / "report.html").read_text("utf-8") else {"report.html"}
    )
    print(f"{version.strip()}: installed alone, it selects and reports.")


def flight() -> str:
    """A manoeuvre whose pitching moment depends on angle of attack and elevator, with noise."""
    source = random.Random(1)
    lines = ["t,alpha,de,Cm"]
    for k in range(400):
        t = 0.04 * k
        alpha, de = 0.1 + 0.03 * math.sin(0.7 * t), 0.05 * (-1.0) ** int(t / 1.7)
        lines.append(f"{t:.2f},{alpha:.9f},{de},{0.02 - 0.5 * alpha - 1.5 * de + source.gauss(0.0, 0.001):.9f}")
    return "\n".join(lines) + "\n"


def run(folder: Path, *command: object) -> str:
    """Run a program; what it says on stdout."""
    done = subprocess.run(list(map(str, command)), cwd=folder, stdout=subprocess.PIPE, text=True, check=True)
    return done.stdout


def complain(what: str, names: set[str]) -> None:
    """End with what is wrong, if anything is."""
    if names:
        raise SystemExit(f"{what}: {', '.join(sorted(names))}")


if __name__ == "__main__":
    built = Path(sys.argv[1])
    check_contents(built)
    with tempfile.TemporaryDirectory() as place:
        check_use(built, Path(place))
