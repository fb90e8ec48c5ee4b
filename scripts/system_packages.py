"""Find the system packages that are missing, and install them where that is allowed.

Says what it installs before it does; with ``INSTALL=0`` in the environment it only prints the line.
Runs before any environment exists: standard library only. Exit code 0 when all is there,
2 after printing the line to type.
"""

import argparse
import ctypes
import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence

# Debian package of each shared library that the Python wheels do not bring along.
LIBRARIES = {
    "libGL.so.1": "libgl1",  # vtk: crashes without a word where it is missing
    "libEGL.so.1": "libegl1",  # vtk: pictures without a screen
    "libOpenGL.so.0": "libopengl0",  # pymeshlab's plugins
    "libusb-1.0.so.0": "libusb-1.0-0",  # open3d
    "libgomp.so.1": "libgomp1",  # scikit-learn, open3d
}

# For `make test` only: 100 MB that the demo does not need.
BROWSERS = ["chromium", "chromium-browser"]


def library_loads(name: str) -> bool:
    """Whether the dynamic linker finds the library and all that it needs itself."""
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


class Machine:
    """What this machine has, may and does; tests pretend another."""

    user = os.geteuid()
    may_install = os.environ.get("INSTALL") != "0"

    def find(self, program: str) -> str | None:
        """Path of a program; None where there is none."""
        return shutil.which(program)

    def missing(self, *, with_uv: bool) -> list[str]:
        """Debian packages that environments need here; uv replaces Python's own ensurepip."""
        packages = [package for name, package in LIBRARIES.items() if not library_loads(name)]
        if not with_uv and importlib.util.find_spec("ensurepip") is None:
            packages.append(f"python{sys.version_info.major}.{sys.version_info.minor}-venv")
        return packages

    def run(self, command: Sequence[str]) -> bool:
        """Run a command without its output and without questions; whether it succeeded."""
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
        return done.returncode == 0


def apt_prefix(machine: Machine) -> list[str] | None:
    """What to write before ``apt-get`` to install without a question; None where not allowed."""
    if not machine.may_install or machine.find("apt-get") is None:
        return None
    quiet = ["env", "DEBIAN_FRONTEND=noninteractive"]
    if machine.user == 0:
        return quiet
    if machine.find("sudo") is not None and machine.run(["sudo", "-n", "true"]):
        return ["sudo", "-n", *quiet]
    return None


def install(packages: Sequence[str], machine: Machine) -> bool:
    """Say what is installed, then do it; a second try with new lists (a fresh image has none)."""
    prefix = apt_prefix(machine)
    if prefix is None:
        return False
    names = " ".join(packages)
    print(f"Installing system packages: {names} (INSTALL=0 only prints the line)", file=sys.stderr)
    # The time-out waits for another apt that is at work, as on a machine just started.
    apt = [*prefix, "apt-get", "-o", "DPkg::Lock::Timeout=120"]
    command = [*apt, "install", "-y", "--no-install-recommends", *packages]
    return machine.run(command) or (machine.run([*apt, "update"]) and machine.run(command))


def line_to_type(packages: Sequence[str], machine: Machine) -> str:
    """The line that tells a person how to go on."""
    names = " ".join(packages)
    if machine.find("apt-get") is None:
        return f"missing system packages (Debian's names): {names}"
    sudo = "" if machine.user == 0 else "sudo "
    line = f"{sudo}apt-get update && {sudo}apt-get install -y {names}"
    return f"missing system packages; please type: {line}"


def main(arguments: Sequence[str] | None = None, machine: Machine | None = None) -> int:
    """Check, install where allowed, check again."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--uv", action="store_true", help="uv makes the environment, not venv")
    parser.add_argument("--browser", action="store_true", help="only the browser for tests")
    options = parser.parse_args(arguments)
    machine = Machine() if machine is None else machine
    if options.browser:
        if not any(map(machine.find, BROWSERS)) and not install(BROWSERS[:1], machine):
            line = line_to_type(BROWSERS[:1], machine)
            print(f"The page is not tested in a browser: {line}", file=sys.stderr)
        return 0
    packages = machine.missing(with_uv=options.uv)
    if packages and install(packages, machine):
        packages = machine.missing(with_uv=options.uv)
    if packages:
        print(f"Stopped: {line_to_type(packages, machine)}", file=sys.stderr)
    return 2 if packages else 0


if __name__ == "__main__":
    sys.exit(main())
