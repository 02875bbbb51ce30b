"""The ROS package msls_ros: its modules, the files it installs and its executables."""

from __future__ import annotations

from pathlib import Path

from setuptools import setup

NAME = "msls_ros"
ROOMS = [
    *("estimation", "estimation.bank", "estimation.dither", "plant", "bags", "report", "fleet"),
    *("inputs", "control", "flights", "offline", "campaigns", "paper", "nodes", "commands"),
]
# Each is msls_ros/commands/NAME.py with a main().
EXECUTABLES = [
    "identifier",
    "mixer",
    "controller",
    "plant",
    "pilot",
    "recorder",
    "watch",
    "demo",
    "inspect",
    "replay",
    "report",
    "paper",
    "campaign",
    "benchmark",
]


def data_files(*folders: str) -> list[tuple[str, list[str]]]:
    """Return the data files of setuptools: every file below each folder, installed under share/msls_ros.

    Parameters
    ----------
    *folders
        Folders of this repository, relative to it.

    Returns
    -------
    list of (str, list of str)
        Destination folder and its source files.
    """
    found: dict[str, list[str]] = {}
    for folder in folders:
        for path in sorted(Path(folder).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                found.setdefault(f"share/{NAME}/{path.parent}", []).append(str(path))
    return sorted(found.items())


setup(
    name=NAME,
    version="0.1.0",
    description="Online identification of an aircraft's linear model, in flight, next to a flight-control stack",
    author="msls_ros maintainers",
    license="Apache-2.0",
    python_requires=">=3.10",
    packages=[NAME, *(f"{NAME}.{room}" for room in ROOMS)],
    package_data={f"{NAME}.plant": ["data/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *data_files("config", "launch"),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest", "hypothesis", "pymavlink"], "px4": ["pyulog"]},
    zip_safe=True,
    entry_points={"console_scripts": [f"{name} = {NAME}.commands.{name}:main" for name in EXECUTABLES]},
)
