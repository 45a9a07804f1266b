"""A MJCF file as MuJoCo's specification, with its includes, and without the shapes of missing meshes."""

import importlib
from pathlib import Path
from typing import Any

from poise.errors import ErrorCode, InputError

_MAX_BYTES = 50_000_000
_MAX_NODES = 5_000
"""Bodies of a model that is read."""


def imported_mujoco() -> Any:
    """The module `mujoco`; it loads slowly, and only the extra `sim` brings it.

    Raises:
        InputError: UNSUPPORTED when it is not installed.
    """
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise InputError(
            ErrorCode.UNSUPPORTED, "models of MuJoCo need MuJoCo, which is not installed: pip install 'poise[sim]'"
        ) from error


def loaded_spec(path: Path) -> tuple[Any, Any, tuple[str, ...]]:
    """MuJoCo's specification of a file, its compiled model, and what was left out, as clauses.

    A shape whose mesh file is missing is left out, unless the mass of its body comes from it.

    Raises:
        InputError: UNSUPPORTED without MuJoCo, FILE_UNREADABLE, ROBOT_DESCRIPTION_INVALID with what MuJoCo says.
    """
    mujoco = imported_mujoco()
    _check_file(path)
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise _invalid(path, str(error)) from error
    if len(spec.bodies) > _MAX_NODES:
        raise InputError(ErrorCode.ROBOT_DESCRIPTION_INVALID, f"{path}: more than {_MAX_NODES} bodies")
    # Bodies keep their names, and masses come from shapes where the file says so.
    spec.compiler.fusestatic = spec.compiler.discardvisual = False
    missing = _missing_meshes(spec, path)
    lost = _without_meshes(spec, missing, path) if missing else ()
    try:
        return spec, spec.compile(), lost
    except (ValueError, mujoco.FatalError) as error:
        raise _invalid(path, str(error)) from error


def _check_file(path: Path) -> None:
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(ErrorCode.ROBOT_DESCRIPTION_INVALID, f"{path}: larger than {_MAX_BYTES} bytes")
        path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputError(ErrorCode.ROBOT_DESCRIPTION_INVALID, f"{path}: not UTF-8 text") from error
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"cannot read the model {path}: {error.strerror}") from error


def _invalid(path: Path, said: str) -> InputError:
    reason = " ".join(said.split())[:400]
    advice = "; an included file is missing: keep it beside the model" if "include" in reason.lower() else ""
    return InputError(ErrorCode.ROBOT_DESCRIPTION_INVALID, f"{path}: MuJoCo cannot load it: {reason}{advice}")


def _missing_meshes(spec: Any, path: Path) -> set[str]:
    """The names of the mesh assets whose file is not there."""
    found = set()
    for mesh in spec.meshes:
        folders = (path.parent / (spec.modelfiledir or "") / (spec.meshdir or ""), path.parent / (spec.meshdir or ""))
        if mesh.file and not Path(mesh.file).is_absolute():
            if not any((folder / mesh.file).is_file() for folder in folders):
                found.add(mesh.name or Path(mesh.file).stem)
        elif mesh.file and not Path(mesh.file).is_file():
            found.add(mesh.name or Path(mesh.file).stem)
    return found


def _without_meshes(spec: Any, missing: set[str], path: Path) -> tuple[str, ...]:
    """Take the shapes of missing meshes out.

    Raises:
        InputError: FILE_UNREADABLE when a body has its mass from one of them.
    """
    for geom in [each for each in spec.geoms if each.meshname in missing]:
        body = geom.parent
        weighs = geom.mass != 0.0 and not body.explicitinertial
        if weighs and body.name != "world":
            raise InputError(
                ErrorCode.FILE_UNREADABLE,
                f"{path}: the mesh {geom.meshname} is missing, and body {body.name} has its mass from it: keep the"
                " meshes beside the model, or give the body an inertial",
            )
        spec.delete(geom)
    for mesh in [each for each in spec.meshes if (each.name or Path(each.file).stem) in missing]:
        spec.delete(mesh)
    return (f"shapes of the missing meshes {', '.join(sorted(missing))}",)
