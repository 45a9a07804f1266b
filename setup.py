# How poise is installed: by colcon as an ament_python package, by pip with its interfaces, or the core without ROS.
import hashlib
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

from setuptools import Distribution, Extension, find_packages, setup

PACKAGE = "poise"
HERE = Path(__file__).resolve().parent  # the sources, also where colcon --symlink-install runs a link to this file
# `POISE_CORE=1 pip install .` installs the library and the command line alone: no ROS, no nodes, no need of a compiler.
CORE_ONLY = os.environ.get("POISE_CORE", "0") not in ("", "0")

# Executables of `ros2 run poise NAME`.
NODES = {
    "acceleration_limits": "poise.nodes.acceleration_limits:main",
    "fake_robot": "poise.fake_robots.fake_robot_node:main",
    "ft_driver": "poise.nodes.ft_driver:main",
    "gripper_driver": "poise.nodes.gripper_driver:main",
    "inertial_estimator": "poise.nodes.inertial_estimator:main",
    "loop": "poise.nodes.loop:main",
    "mismatch_diagnoser": "poise.nodes.mismatch_diagnoser:main",
    "object_carrier": "poise.nodes.object_carrier:main",
    "object_picker": "poise.nodes.object_picker:main",
    "object_scanner": "poise.nodes.object_scanner:main",
    "placement_planner": "poise.nodes.placement_planner:main",
    "robustness_server": "poise.nodes.robustness_server:main",
    "world_model": "poise.nodes.world_model:main",
}
# Interface packages that pip has to build: ours, and those that PyPI does not have.
INTERFACES = {"poise_msgs": "msg_defs", "tf2_msgs": "third_party/tf2_msgs", "control_msgs": "third_party/control_msgs"}


# A colcon build on PyPI alone (test/nodes/test_install.py) needs the packages that pip fetches for its own builds.
BUILD_REQUIRES = tomllib.loads((HERE / "pyproject.toml").read_text())["tool"]["poise"]["interface-build-requires"]
CORE_REQUIRES = [
    "clarabel>=0.9",
    "coal>=3",
    "numpy>=2",  # what the pin wheels are built against
    "scipy>=1.15",
    "pin>=3.2",
    "pyyaml>=6",
    "rosbags>=0.11,<0.12",  # its API changes between minor releases
    "mcap>=1.6,<2",  # the first release whose reader checks the checksum of the data section
    "lz4>=4",
    "zstandard>=0.22",
    "pyserial>=3.5",
    "pymodbus>=3.9,<4",
    "jinja2>=3.1",
    "matplotlib>=3.8",
    "pillow>=10",
    "typer>=0.15",
    "rich>=13",
    "shapely>=2",
    "trimesh>=4.4",
    "manifold3d>=3",
]
ROS_REQUIRES = [
    "setuptools",
    # ROS 2 Jazzy from PyPI: always the ros-jazzy names (a bare ros-rclpy is another distribution's).
    "ros-jazzy-rclpy[fastrtps]==7.1.6",
    "ros-jazzy-common-interfaces==5.3.6",
]
SIM_REQUIRES = ["mujoco>=3.2"]  # rollouts, and the physics engine that benchmarks/concealed records with
BASELINE_REQUIRES = ["pybullet>=3.2"]  # the engine of Algorithm 3 of the thesis, for comparison
# A Dask cluster, files at URLs, and results as Parquet for `poise evaluate`.
FLEET_REQUIRES = ["distributed>=2024.8", "fsspec>=2024.6", "pyarrow>=15"]
USD_REQUIRES = ["usd-core>=24.11"]  # meshes in USD files
VISION_REQUIRES = ["opencv-python-headless>=4.8"]  # finds printed boards
# The site (`make docs`), and notebooks that CI executes.
DOCS_REQUIRES = [
    *("sphinx>=8", "furo>=2024.8", "myst-nb>=1.1", "sphinx-copybutton", "sphinx-design", "sphinxcontrib-mermaid>=1"),
    *("ipykernel", "nbclient"),
]


def files(folder: str, pattern: str) -> list[str]:
    return sorted(str(path) for path in Path(folder).glob(pattern) if path.is_file())


def build_interfaces(name: str, source: str) -> list[tuple[str, list[str]]]:
    """Build one interface package against the ROS wheels; kept until its sources change."""
    sources = sorted(path for path in Path(source).rglob("*") if path.is_file())
    digest = hashlib.sha256(sys.version.encode())
    for path in sources:
        digest.update(str(path).encode() + path.read_bytes())
    work = HERE / "build" / f"{name}-{digest.hexdigest()[:12]}"
    installed = work / "install"
    if not (work / "done").exists():
        # pip's build environment moves between builds: a kept CMake cache would name a vanished one.
        shutil.rmtree(work, ignore_errors=True)
        hook = HERE / "msg_defs" / "cmake" / "pypi_wheels.cmake"
        subprocess.check_call(
            [
                "cmake",
                "-S",
                source,
                "-B",
                work / "build",
                "-G",
                "Ninja",
                "-DCMAKE_BUILD_TYPE=Release",
                "-DBUILD_TESTING=OFF",
                f"-DPython3_EXECUTABLE={sys.executable}",
                f"-DCMAKE_INSTALL_PREFIX={installed}",
                f"-DCMAKE_PROJECT_{name}_INCLUDE={hook}",
            ]
        )
        subprocess.check_call(["cmake", "--build", work / "build", "--target", "install"])
        shutil.rmtree(work / "build")
        (work / "done").touch()
    unwanted = (
        "include",
        ".egg-info",
        "__pycache__",
    )  # pip writes its own metadata; no C++ is built against it
    groups: dict[str, list[str]] = {}
    for path in sorted(installed.rglob("*")):
        relative = path.relative_to(installed)
        if path.is_file() and not any(part.endswith(unwanted) for part in relative.parts):
            groups.setdefault(str(relative.parent), []).append(str(path.relative_to(HERE)))
    return list(groups.items())


def write_shims() -> list[str]:
    """Write lib/poise/NAME for `ros2 run` and launch, which pip (unlike colcon) does not fill by itself."""
    folder = Path("build/shims")
    folder.mkdir(parents=True, exist_ok=True)
    for name in NODES:
        shim = folder / name
        shim.write_text(f'#!/bin/sh\nexec "$(dirname "$0")/../../bin/{name}" "$@"\n')
        shim.chmod(0o755)
    return [str(folder / name) for name in NODES]


# Inner loops in C, called through ctypes: no header of Python or numpy is needed. Without a compiler the core is
# installed without them, and computes the same in Python. A module of its own, so that a source tree on PYTHONPATH,
# which shadows the package `poise`, uses the installed one.
KERNELS = Extension(
    "poise_kernels",
    sources=files("kernels", "*.c"),
    depends=files("kernels", "*.h"),
    # The same rounding everywhere; roots that set no errno, so that vectors of them are taken at once.
    extra_compile_args=["-std=c11", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fvisibility=hidden"],
    libraries=["m"],
    py_limited_api=True,  # of no Python version in particular
    optional=CORE_ONLY,
)


class BinaryDistribution(Distribution):
    """The interfaces are compiled: the wheel belongs to one Python and platform."""

    def has_ext_modules(self) -> bool:
        return True


data_files = [(f"share/{PACKAGE}/bags", files("bags", "*"))]
for folder in ("", "/placement"):
    data_files.append((f"share/{PACKAGE}/scenes{folder}", files(f"docs/scenes{folder}", "*")))
scripts = ["poise = poise.cli:main"]
options: dict[str, object] = {"options": {"bdist_wheel": {"py_limited_api": "cp311"}}} if CORE_ONLY else {}
if not CORE_ONLY:
    data_files += [
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", files("launch", "*.launch.py")),
        (f"share/{PACKAGE}/config", files("config", "*")),
        (f"share/{PACKAGE}/config/sros2", files("config/sros2", "*")),
    ]
    scripts += [f"{name} = {target}" for name, target in NODES.items()]
    if "bdist_wheel" in sys.argv:  # pip and uv pass this command; colcon builds poise_msgs as a package
        for name, source in INTERFACES.items():
            data_files += build_interfaces(name, source)
        data_files.append((f"lib/{PACKAGE}", write_shims()))
        options["distclass"] = BinaryDistribution

setup(
    name=PACKAGE,
    version="0.2.0",
    description="Weigh, push, place and carry objects of unknown inertia with a mobile manipulator",
    license="Apache-2.0",
    packages=find_packages(
        include=["poise", "poise.*"],
        exclude=["poise.nodes*", "poise.fake_robots*"] if CORE_ONLY else [],
    ),
    package_data={"poise": ["py.typed", *(f"**/*.{kind}" for kind in ("j2", "urdf", "css", "js", "json", "yaml"))]},
    data_files=data_files,
    ext_modules=[KERNELS],
    zip_safe=False,
    python_requires=">=3.11",
    install_requires=CORE_REQUIRES + ([] if CORE_ONLY else ROS_REQUIRES),
    extras_require={
        "viewer": ["rerun-sdk>=0.30"],
        "sim": SIM_REQUIRES,
        "baselines": BASELINE_REQUIRES,
        "vision": VISION_REQUIRES,
        "fleet": FLEET_REQUIRES,
        "docs": DOCS_REQUIRES,
        "usd": USD_REQUIRES,
        "test": [
            "pytest>=8",
            "pytest-timeout",
            "pytest-xdist",
            "hypothesis",
            "ruff==0.17.5",  # another release formats differently
            "mypy==2.4.1",  # another release reports other errors
            "types-PyYAML",
            "types-pyserial",
            "pre-commit",
            "colcon-common-extensions",
            # 70.1 brings bdist_wheel; 80 removed `develop --editable`, which colcon build --symlink-install calls.
            "setuptools>=70.1,<80",
            "mcap-ros2-support",  # a second reader, for tests and benchmarks/bags.py
            *SIM_REQUIRES,
            *BASELINE_REQUIRES,
            *VISION_REQUIRES,
            *FLEET_REQUIRES,
            *DOCS_REQUIRES,
            *USD_REQUIRES,
            *BUILD_REQUIRES,
        ],
    },
    entry_points={"console_scripts": scripts},
    **options,
)
