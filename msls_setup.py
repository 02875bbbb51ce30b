"""What ./msls does: set up what is missing, then run one of the executables of msls_ros (see HELP)."""

import ast
import difflib
import fcntl
import hashlib
import json
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Dict, List, NoReturn, Optional, Sequence, Tuple

ROOT = Path(__file__).resolve().parent
VENV = ROOT / ".venv"
PYTHON = str(VENV / "bin" / "python")
INSTALL = ROOT / "install"
STATE = ROOT / ".msls"  # lock and log of the set-up
LOG = STATE / "setup.log"
VENV_STAMP = VENV / "msls_stamp.json"
BUILD_STAMP = INSTALL / "msls_stamp.json"
LOCK = "requirements.lock"
EXTRA_LOCKS = {"benchmark": "requirements-benchmark.lock"}  # executables that need more packages
NODES = ("identifier", "mixer", "controller", "plant", "pilot", "recorder")
SETUP_VERSION = 2  # raise it to make every set-up start anew
# Folders of packages that no program of ours imports: their byte code would take as long to make as that of the others.
NOT_IMPORTED = r"/site-packages/(.*/)?(tests?|pip|setuptools|mypy|mypyc|docutils|fontTools|dialects)/"
PYTHONS = ("3.10", "3.11", "3.12", "3.13")

HELP = """\
usage: ./msls NAME [ARGS]    set up what is missing, then run; ./msls NAME --help lists its arguments

{executables}

  test         ruff, mypy and all tests; with ARGS: only pytest, with these
  python       the Python in which msls_ros is installed
  setup        set up and stop

The set-up needs Linux on x86-64, Python 3.10 to 3.13 (PYTHON=python3.12 ./msls ... chooses another)
and a C/C++ compiler; all else, ROS 2 Jazzy too, goes into {venv} and {install}.
MSLS_OVERLAY=/path/to/ws/install ./msls ... adds packages that you have built (several: joined by ':').
With ROS 2 Jazzy from apt this script is not needed: see docs/own_stack.md."""

ELSEWHERE = "on Ubuntu 24.04 install ROS 2 Jazzy from apt and build with colcon instead, see docs/own_stack.md"

# What a shell with another ROS sourced would leak into ours. RMW_IMPLEMENTATION: only Fast DDS comes with the wheels.
LEAKING = re.compile(
    "(AMENT|COLCON|_COLCON|_ROS_WHEELS)_.*|CMAKE_PREFIX_PATH|PYTHONPATH|PYTHONHOME|RMW_IMPLEMENTATION"
    "|ROS_(DISTRO|VERSION|PYTHON_VERSION|PACKAGE_PATH|ROOT|ETC_DIR|MASTER_URI)"
)
# Letters that CMake, make, the shell scripts of ROS and lists of paths all take in the path of a folder.
PLAIN_PATH = re.compile(r"[A-Za-z0-9_./+@%^~,=-]+")
NO_NETWORK = re.compile(
    "NewConnectionError|NameResolutionError|ConnectTimeout|name resolution|dns error|Network is unreachable"
    "|Failed to establish a new connection|Could not connect|failed to lookup address|tcp connect error"
    r"|\(from versions: none\)"  # all that pip says of it when it is quiet
)
PREFIXES = ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "COLCON_PREFIX_PATH", "ROS_PACKAGE_PATH")
LISTS = ("PATH", "LD_LIBRARY_PATH", "PKG_CONFIG_PATH")
OVERLAY = "MSLS_OVERLAY"  # the user's workspaces; set, be it empty, in all that ./msls starts

START = time.monotonic()


class SetupError(Exception):
    """What is missing or failed, in one sentence for people; before it, the end of what the failed step printed."""

    def __init__(self, text: str, output: str = "") -> None:
        super().__init__(text)
        self.output = output


def say(text: str) -> None:
    """Print one line of progress to stderr."""
    print(f"msls [{time.monotonic() - START:5.1f} s] {text}", file=sys.stderr, flush=True)


def digest(paths: Sequence[Path], *more: str) -> str:
    """Return a hash of the names and contents of files, and of further strings."""
    total = hashlib.sha256(repr(more).encode())
    for path in sorted(paths):
        content = path.read_bytes()
        total.update(f"{path.relative_to(ROOT)} {len(content)}\n".encode() + content)
    return total.hexdigest()


def read_json(path: Path) -> Dict[str, Any]:
    """Return the object in a JSON file; an empty one if there is none or it is damaged."""
    try:
        value = json.loads(path.read_text())
    except (OSError, ValueError):
        return {}
    return value if isinstance(value, dict) else {}


def write(path: Path, text: str) -> None:
    """Replace a file in one step; what it was a hard link to stays as it was."""
    fresh = path.with_name(f"{path.name}.{os.getpid()}")
    fresh.write_text(text)
    fresh.replace(path)


# --- the environment ---


def clean_environment() -> Dict[str, str]:
    """Return this process's environment without what another ROS has put there."""
    roots = {"/opt/ros"}
    for name in PREFIXES:
        roots.update(part.rstrip("/") for part in os.environ.get(name, "").split(os.pathsep) if part.startswith("/"))
    roots -= {"", "/usr", "/usr/local"}
    env = {name: value for name, value in os.environ.items() if not LEAKING.fullmatch(name)}
    for name in LISTS:
        parts = [part for part in env.pop(name, "").split(os.pathsep) if part]
        kept = [part for part in parts if not any(part == root or part.startswith(root + "/") for root in roots)]
        if kept:
            env[name] = os.pathsep.join(kept)
    if not os.environ.get("HOME") or not os.access(os.path.expanduser("~"), os.W_OK):
        env.setdefault("ROS_HOME", str(STATE / "ros"))  # rclpy wants to write its log
        env.setdefault("UV_CACHE_DIR", str(STATE / "uv"))
        env.setdefault("MPLCONFIGDIR", str(STATE / "matplotlib"))
    return env


def prepend(env: Dict[str, str], variables: Dict[str, str]) -> Dict[str, str]:
    """Return the environment with variables set; those that are lists of paths go in front of what is there."""
    result = dict(env)
    for name, value in variables.items():
        old = env.get(name) if name in LISTS else None
        result[name] = value + os.pathsep + old if old else value
    return result


def underlay(version: str) -> Dict[str, str]:
    """Return the variables that make the virtual environment a ROS installation (to be prepended)."""
    libraries = [VENV / "lib", *sorted((VENV / "lib" / f"python{version}" / "site-packages").glob("ros_*.libs"))]
    return {
        "AMENT_PREFIX_PATH": str(VENV),
        "CMAKE_PREFIX_PATH": str(VENV),
        "PATH": str(VENV / "bin"),
        "LD_LIBRARY_PATH": os.pathsep.join(map(str, libraries)),
        "ROS_DISTRO": "jazzy",
        "ROS_VERSION": "2",
        "ROS_PYTHON_VERSION": "3",
        "VIRTUAL_ENV": str(VENV),
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",  # else the wheels start every Python twice
    }


def overlay(version: str, more: Sequence[Path] = ()) -> Dict[str, str]:
    """Return the variables of the two packages on top of the underlay, as install/setup.bash sets them.

    The prefixes of the user's own packages come between the two.
    """
    messages, package, site = INSTALL / "msls_msgs", INSTALL / "msls_ros", f"lib/python{version}/site-packages"
    below = underlay(version)
    above: Dict[str, List[Any]] = {
        "AMENT_PREFIX_PATH": [package, messages, *more, below["AMENT_PREFIX_PATH"]],
        "CMAKE_PREFIX_PATH": [messages, below["CMAKE_PREFIX_PATH"]],
        "LD_LIBRARY_PATH": [messages / "lib", *(prefix / "lib" for prefix in more), below["LD_LIBRARY_PATH"]],
        "PYTHONPATH": [
            ROOT / "build" / "msls_ros",
            package / site,
            messages / site,
            *(prefix / site for prefix in more),
        ],
        OVERLAY: [os.environ.get(OVERLAY, "")],
    }
    return {**below, **{name: os.pathsep.join(map(str, paths)) for name, paths in above.items()}}


def is_prefix(folder: Path) -> bool:
    """Return whether ROS packages are installed in a folder: one of them, or all of a merged workspace."""
    return (folder / "share" / "ament_index" / "resource_index" / "packages").is_dir()


def overlay_prefixes(version: str) -> List[Path]:
    """Return the prefixes of the install folders that MSLS_OVERLAY names, refusing what this Python cannot import."""
    found: List[Path] = []
    for part in filter(None, os.environ.get(OVERLAY, "").split(os.pathsep)):
        folder = Path(os.path.abspath(part))
        if not folder.is_dir():
            raise SetupError(f"{OVERLAY}: {folder} is no folder; expected the install folder of a workspace")
        prefixes = [folder] if is_prefix(folder) else sorted(path for path in folder.iterdir() if is_prefix(path))
        if not prefixes:
            inner = f"{folder}/install" if (folder / "install").is_dir() else "the install folder of a workspace"
            raise SetupError(f"{OVERLAY}: {folder} holds no ROS package; expected {inner}")
        check_prefixes(folder, prefixes, version)
        found += prefixes
    return found


def check_prefixes(folder: Path, prefixes: Sequence[Path], version: str) -> None:
    """Refuse packages of another Python, and a ROS of its own in the place of ours."""
    recipe = f"Python {version}: colcon build --cmake-args -DPython3_EXECUTABLE={PYTHON}, see docs/own_stack.md"
    usable = False
    for prefix in prefixes:
        sites = sorted(prefix.glob("lib/python3*/site-packages"))
        pythons = [site.parent.name[len("python") :] for site in sites]
        if sites and version not in pythons:
            raise SetupError(f"{OVERLAY}: {prefix} is built for Python {', '.join(pythons)}, expected {recipe}")
        if any((site / "rclpy").exists() for site in sites):
            raise SetupError(f"{OVERLAY}: {prefix} holds a ROS of its own (rclpy); name workspaces on top of ours only")
        usable = usable or bool(sites)
    if not usable:
        raise SetupError(f"{OVERLAY}: {folder} holds no package for Python, expected one for {recipe}")


# --- the set-up ---


class Turn:
    """The right to set up: one process at a time; the programs it starts hold it too, should it be killed."""

    descriptor = -1

    def __enter__(self) -> None:
        """Wait for the turn."""
        STATE.mkdir(exist_ok=True)
        Turn.descriptor = os.open(STATE / "lock", os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(Turn.descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say("another ./msls is setting up; waiting for it")
            fcntl.flock(Turn.descriptor, fcntl.LOCK_EX)

    def __exit__(self, *_: object) -> None:
        """Give it back."""
        os.close(Turn.descriptor)
        Turn.descriptor = -1


def run_logged(command: Sequence[str], env: Dict[str, str], what: str) -> None:
    """Run a step of the set-up; its output goes to the log."""
    with LOG.open("ab") as log:
        log.write(f"\n$ {' '.join(command)}\n".encode())
        log.flush()
        start = log.tell()
        held = [Turn.descriptor]
        done = subprocess.run(
            command, cwd=ROOT, env=env, stdin=subprocess.DEVNULL, stdout=log, stderr=log, pass_fds=held, check=False
        )
    if done.returncode != 0:
        output = LOG.read_bytes()[start:].decode(errors="replace")
        if NO_NETWORK.search(output):
            raise SetupError(f"no network, or an index without the packages: {what} failed; all output is in {LOG}")
        tail = output.splitlines()[-25:]
        text = f"{what} failed (exit code {done.returncode}); the whole output is in {LOG}"
        raise SetupError(text, "\n".join(tail))


def check_folder() -> None:
    """Refuse a folder in which nothing can be built."""
    if not PLAIN_PATH.fullmatch(str(ROOT)):
        strange = next(letter for letter in str(ROOT) if not PLAIN_PATH.fullmatch(letter))
        name = "a space" if strange == " " else ascii(strange)
        shown = str(ROOT).encode("utf-8", "replace").decode()
        raise SetupError(f"{shown}: CMake and ROS cannot build in a path with {name}; move the folder elsewhere")


def check_machine() -> None:
    """Refuse a machine for which there are no wheels, or that cannot compile."""
    if sys.platform != "linux" or platform.machine() not in ("x86_64", "AMD64"):
        machine = f"{sys.platform} on {platform.machine()}"
        raise SetupError(f"the ROS 2 wheels are for Linux on x86-64, this is {machine}; {ELSEWHERE}")
    library, version = platform.libc_ver()
    if library != "glibc" or tuple(map(int, version.split(".")[:2])) < (2, 28):
        found = f"{library or 'another C library'} {version}".strip()
        raise SetupError(f"the ROS 2 wheels need glibc 2.28 or newer, found {found}; {ELSEWHERE}")
    tools = {
        "a C compiler (gcc or clang)": [os.environ.get("CC") or "cc", "gcc", "clang"],
        "a C++ compiler (g++ or clang++)": [os.environ.get("CXX") or "c++", "g++", "clang++"],
    }
    missing = [what for what, names in tools.items() if not any(shutil.which(name.split()[0]) for name in names)]
    if missing:
        raise SetupError(f"missing: {', '.join(missing)}; on Debian and Ubuntu: sudo apt install build-essential")


def inspect_python(python: str) -> Tuple[str, str]:
    """Return version (3.11) and base executable of an interpreter, refusing one that will not do."""
    code = (
        "import json, os, sys, sysconfig, importlib.util as u\n"
        "header = os.path.join(sysconfig.get_path('include'), 'Python.h')\n"
        "print(json.dumps(['%d.%d' % sys.version_info[:2], sys.implementation.name, os.path.exists(header),"
        " u.find_spec('ensurepip') is not None and u.find_spec('venv') is not None,"
        " getattr(sys, '_base_executable', None) or sys.executable]))"
    )
    try:
        quiet = subprocess.DEVNULL
        done = subprocess.run(
            [python, "-c", code], stdout=subprocess.PIPE, stderr=quiet, env=clean_environment(), check=False
        )
        version, implementation, header, venv, executable = json.loads(done.stdout.decode())
    except (OSError, ValueError):
        raise SetupError(f"{python} does not run as a Python 3.10 to 3.13; PYTHON= names another") from None
    if version not in PYTHONS or implementation != "cpython":
        found = f"{python} is {implementation} {version}"
        raise SetupError(f"{found}, needed is CPython 3.10 to 3.13; PYTHON=python3.12 ./msls ... chooses one")
    apt = "on Debian and Ubuntu: sudo apt install"
    if not venv:
        raise SetupError(f"{python} cannot make virtual environments; {apt} python{version}-venv python{version}-dev")
    if not header:
        raise SetupError(f"the C headers of {python} (Python.h) are missing; {apt} python{version}-dev")
    return version, executable


def pins(path: Path, *names: str) -> str:
    """Write the pins of a few packages of the lock, hashes included, into a file of their own and return its path."""
    blocks = re.findall(r"^[^\s#].*\\\n(?: .*\n)+", (ROOT / LOCK).read_text(), re.MULTILINE)
    write(path, "".join(block for block in blocks if block.split("==")[0] in names))
    return str(path)


def install_lock(name: str) -> None:
    """Install a lock file into the virtual environment, hashes checked: with uv, or with pip where uv cannot."""
    env = prepend(clean_environment(), {"_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1"})
    pip = [PYTHON, "-m", "pip", "install", "--disable-pip-version-check", "--no-compile"]
    uv = [str(VENV / "bin" / "uv"), "pip", "install", "--python", PYTHON]
    options = ["--quiet", "--require-hashes", "--no-deps", "--no-build-isolation", "-r"]
    if name == LOCK:  # first what builds those among the others that come as sources
        run_logged([*pip, *options, pins(VENV / "setuptools.lock", "setuptools")], env, "installing setuptools")
    try:
        if not os.path.exists(uv[0]):
            run_logged([*pip, *options, pins(VENV / "uv.lock", "uv")], env, "installing uv")
        run_logged([*uv, *options, str(ROOT / name)], env, "installing with uv")
    except SetupError:
        say("uv cannot; installing with pip")
        run_logged([*pip, *options, str(ROOT / name)], env, f"installing {name}")


def keep_bytecode(*folders: Path) -> None:
    """Compile what programs import: where PYTHONDONTWRITEBYTECODE is set, each start would, for up to five seconds."""
    command = [PYTHON, "-m", "compileall", "-q", "-j", "0", "-x", NOT_IMPORTED, *map(str, folders)]
    with LOG.open("ab") as log:  # a file that is for another Python does not compile, and is not imported
        subprocess.run(command, cwd=ROOT, env=clean_environment(), stdout=log, stderr=log, check=False)


def make_underlay(version: str) -> None:
    """Make the virtual environment look like /opt/ros/jazzy to CMake and colcon."""
    code = "import json, sysconfig, numpy; print(json.dumps([sysconfig.get_path('include'), numpy.get_include()]))"
    env = prepend(clean_environment(), {"_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1"})
    done = subprocess.run([PYTHON, "-c", code], env=env, stdout=subprocess.PIPE, check=True)
    python_include, numpy_include = json.loads(done.stdout.decode())
    for path in VENV.glob("share/*/cmake/*__rosidl_generator_pyExport.cmake"):
        text = path.read_text()  # holds two paths of the machine that built the wheels
        text = re.sub(r'(?<=[";])/[^;"]*/include/python3\.\d+(?=[;"])', lambda _: python_include, text)
        text = re.sub(r'(?<=[";])/[^;"]*/numpy/_?core/include(?=[;"])', lambda _: numpy_include, text)
        write(path, text)
    for path in list((VENV / "share/ament_index/resource_index/parent_prefix_path").iterdir()):
        write(path, "")
    lines = ["# Written by ./msls: the virtual environment as a ROS underlay."]
    for name, value in underlay(version).items():
        quoted = "'" + value.replace("'", "'\\''") + "'"
        rest = f'"${{{name}:+:${name}}}"' if name in (*LISTS, *PREFIXES) else ""
        lines.append(f"export {name}={quoted}{rest}")
    for script in ("setup.sh", "setup.bash", "local_setup.sh", "local_setup.bash"):
        write(VENV / script, "\n".join(lines) + "\n")


def make_venv(stamp: Dict[str, str], python: str) -> None:
    """Make the virtual environment anew, its stamp last."""
    LOG.write_bytes(b"")
    say(f"making a virtual environment with Python {stamp['python']} (all of the set-up: about a minute)")
    for folder in (VENV, ROOT / "build", INSTALL):
        shutil.rmtree(folder, ignore_errors=True)
    run_logged([python, "-m", "venv", str(VENV)], clean_environment(), "making the virtual environment")
    say(f"installing ROS 2 Jazzy and the rest of {LOCK}")
    install_lock(LOCK)
    keep_bytecode(VENV / "lib")
    make_underlay(stamp["python"])
    write(VENV_STAMP, json.dumps(stamp))


def build(package: str, version: str) -> None:
    """Build one of the two packages with colcon, which reads colcon_defaults.yaml."""
    say(f"building {package}")
    for folder in (ROOT / "build" / package, INSTALL / package):
        shutil.rmtree(folder, ignore_errors=True)
    env = prepend(clean_environment(), underlay(version))
    env["MAKEFLAGS"] = f"-j{os.cpu_count()}"  # colcon's own -l would leave cores idle on a machine with other work
    env["COLCON_DEFAULTS_FILE"] = os.devnull  # the user's own; the one in this folder is read besides
    command = [PYTHON, str(VENV / "bin" / "colcon"), "build", "--packages-select", package]
    command += ["--event-handlers", "console_direct+", "--cmake-args"]
    command += ["-GNinja", "-DBUILD_TESTING=OFF", "-DCMAKE_BUILD_TYPE=Release", f"-DPython3_EXECUTABLE={PYTHON}"]
    run_logged(command, env, f"building {package}")


def wanted_venv(chosen: str, current: Dict[str, Any]) -> Dict[str, str]:
    """Return what the stamp of the virtual environment must be: it keeps its Python unless PYTHON= says otherwise."""
    version = current.get("python")
    if chosen or version not in PYTHONS or not os.path.exists(PYTHON):
        version = inspect_python(chosen or sys.executable)[0]
    return {"python": version, "lock": digest([ROOT / LOCK], str(SETUP_VERSION), str(ROOT))}


def wanted_builds(venv: Dict[str, str]) -> Dict[str, str]:
    """Return what the stamps of the two packages must be; files of msls_ros are linked, so few of them count."""
    messages = [path for path in (ROOT / "msg_defs").rglob("*") if path.is_file()]
    linked = [path for folder in ("config", "launch") for path in (ROOT / folder).rglob("*") if path.is_file()]
    files = [ROOT / name for name in ("setup.py", "setup.cfg", "package.xml")]
    return {
        "msls_msgs": digest(messages, json.dumps(venv)),
        "msls_ros": digest(files, json.dumps(venv), *sorted(str(path.relative_to(ROOT)) for path in linked)),
    }


def set_up() -> str:
    """Do what is missing of the set-up and return the version of its Python (3.11)."""
    check_folder()
    chosen = os.environ.get("PYTHON", "")
    current = read_json(VENV_STAMP)
    venv = wanted_venv(chosen, current)
    if current != venv or read_json(BUILD_STAMP) != wanted_builds(venv):
        check_machine()
        with Turn():
            venv = set_up_alone(chosen)
    return venv["python"]


def set_up_alone(chosen: str) -> Dict[str, str]:
    """Do what is missing, nobody else doing so, and return the stamp of the virtual environment."""
    current = read_json(VENV_STAMP)
    venv = wanted_venv(chosen, current)
    if current != venv:
        make_venv(venv, inspect_python(chosen or sys.executable)[1])
    done = read_json(BUILD_STAMP)
    for package, stamp in wanted_builds(venv).items():
        if done.get(package) != stamp:
            done.pop(package, None)
            if INSTALL.is_dir():
                write(BUILD_STAMP, json.dumps(done))
            build(package, venv["python"])
            done[package] = stamp
            write(BUILD_STAMP, json.dumps(done))
            say(f"built {package}")
            keep_bytecode(INSTALL / package, ROOT / "msls_ros")
    return venv


def add_packages(name: str) -> None:
    """Install the further packages that an executable needs, once."""
    marker, wanted = VENV / f"msls_{name}.json", {"lock": digest([ROOT / EXTRA_LOCKS[name]])}
    if read_json(marker) != wanted:
        with Turn():
            say(f"installing {EXTRA_LOCKS[name]}")
            install_lock(EXTRA_LOCKS[name])
            keep_bytecode(VENV / "lib")
            write(marker, json.dumps(wanted))


# --- running ---


def executables() -> Dict[str, str]:
    """Return the executables that setup.py declares, each with the first line of its module's docstring."""
    names: List[str] = []
    for node in ast.parse((ROOT / "setup.py").read_text()).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "EXECUTABLES":
            names = ast.literal_eval(node.value)
    found = {}
    for name in names:
        path = ROOT / "msls_ros" / "commands" / f"{name}.py"
        text = re.match(r'\s*(?:#.*\n)*"""(.*?)(?:"""|\n)', path.read_text()) if path.exists() else None
        found[name] = text.group(1) if text else ""
    return found


def execute(command: Sequence[str], env: Dict[str, str]) -> NoReturn:
    """Become another program."""
    sys.stderr.flush()
    os.execve(command[0], list(command), env)


COMPILE = "import sys; from msls_ros.estimation.warm_up import warm_up; warm_up(sys.argv[1])"


def test(arguments: Sequence[str], env: Dict[str, str]) -> NoReturn:
    """Run pytest with these arguments; without any: ruff, mypy and all tests, on every core."""
    os.chdir(ROOT)
    if not arguments:
        compile_one = [PYTHON, "-c", COMPILE]
        compiling = [subprocess.Popen([*compile_one, "bank"], env=env)]  # beside mypy, not once per process of pytest
        failed = []
        for check in ("ruff check", "ruff format --check", "mypy"):
            say(check)
            if subprocess.run([PYTHON, "-m", *check.split()], env=env, check=False).returncode != 0:
                failed.append(check)
        if failed:
            for process in compiling:
                process.kill()
            print(f"msls: failed: {', '.join(failed)}; the tests were not run", file=sys.stderr)
            sys.exit(1)
        say("compiling the estimator")
        compiling.append(subprocess.Popen([*compile_one, "msls"], env=env))
        for process in compiling:
            process.wait()  # what it could not compile, a test will name
    say("pytest")
    # A process of pytest that died is not replaced: its files would be handed out again, and the rest wait for ever.
    every = ("--numprocesses=auto", "--dist=loadfile", "--max-worker-restart=0")
    execute([PYTHON, "-m", "pytest", *(arguments or every)], env)


def main(arguments: Sequence[str]) -> Optional[int]:
    """Run one command line."""
    known = executables()
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        lines = "\n".join(f"  {name:12} {text}".rstrip() for name, text in known.items())
        print(HELP.format(executables=lines, venv=VENV.name, install=INSTALL.name))
        return 0
    name, rest = arguments[0], list(arguments[1:])
    names = [*known, "test", "python", "setup"]
    if name not in names:
        near = difflib.get_close_matches(name, names, 1)
        guess = f"; did you mean '{near[0]}'?" if near else ""
        print(f"msls: no executable '{name}'; there are: {', '.join(names)}{guess}", file=sys.stderr)
        return 2
    try:
        version = set_up()
        # What MSLS_OVERLAY names may be built only after the set-up.
        more = overlay_prefixes(version) if name != "setup" else []
        if name in EXTRA_LOCKS and not {"-h", "--help"} & set(rest):
            add_packages(name)
    except SetupError as error:
        print(error.output, f"msls: {error}", sep="\n" if error.output else "", file=sys.stderr)
        return 1
    except OSError as error:
        where = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        print(f"msls: {where}; the set-up writes into {ROOT}", file=sys.stderr)
        return 1
    env = prepend(clean_environment(), overlay(version, more))
    if name == "test":
        test(rest, env)
    if name != "setup":
        if name in NODES and "--repair" not in rest:  # the node lets them through when it can take them
            signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
        script = [] if name == "python" else [str(INSTALL / "msls_ros" / "lib" / "msls_ros" / name)]
        execute([PYTHON, *script, *rest], env)
    return 0


def run(arguments: Sequence[str]) -> Optional[int]:
    """Run one command line; Ctrl-C is an exit code."""
    try:
        return main(arguments)
    except KeyboardInterrupt:
        return 130
