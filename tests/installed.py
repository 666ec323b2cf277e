"""Check an installed copy: run this file with that copy's Python, outside the checkout.

Every file that the packages need must be installed and be identical to the file in the checkout;
the command `ask` must print an answer.
"""

import subprocess
import sys
import sysconfig
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

CHECKOUT = Path(__file__).parents[1]
NEEDED = ".py", ".pyi", ".html", ".md", ".toml", "py.typed"


def check_files() -> int:
    """Compare the files of the three packages with those in the checkout; return their number."""
    n = 0
    for name in "nasm", "pipeline", "workflows":
        folder = Path(str(import_module(name).__file__)).parent
        if CHECKOUT in folder.parents or folder.parent != Path(sysconfig.get_path("purelib")):
            sys.exit(f"{name} is imported from {folder}, not from an installed copy")
        for path in sorted((CHECKOUT / name).rglob("*")):
            if path.name.endswith(NEEDED):
                copy = folder / path.relative_to(CHECKOUT / name)
                if not copy.is_file() or copy.read_bytes() != path.read_bytes():
                    sys.exit(f"{copy} is missing, or differs from the checkout")
                n += 1
        if not (folder / "py.typed").is_file():
            sys.exit(f"{folder} has no py.typed")
    return n


def check_command() -> str:
    """Run `ask` for one forcing with the installed script; return the first line of the answer."""
    script = Path(sysconfig.get_path("scripts")) / "nasm-transport"
    with TemporaryDirectory() as folder:
        command = [script, "ask", "0.3", "0.2", "--out", "out"]
        ended = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        pictures = [*Path(folder, "out").glob("*.png")]
    first = ended.stdout.partition("\n")[0]
    if ended.returncode or not first.startswith("BARRIER") or not pictures:
        sys.exit(f"nasm-transport ask failed: {ended.stdout}{ended.stderr}")
    return first


if __name__ == "__main__":
    print(f"{check_files()} files are installed; nasm-transport ask 0.3 0.2: {check_command()}")
