"""A MuJoCo model of which the recorded joints alone move, driven by recorded commands or efforts."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.simulation.models import JointDrive, imported_mujoco, loaded_spec, read_simulator_model
from poise.simulation.rollout.recorded_run import RecordedRun
from poise.types import Array, Indices

InputKind = Literal["auto", "commands", "efforts"]

_MOST_NUMBERS = 20_000_000
"""Numbers of states that MuJoCo returns at once."""
_KEPT = 0.01
"""s between the states that are kept."""
_LONGEST_DELAY = 5.0
"""s of commands before a window that its filters see."""


@dataclass(frozen=True)
class _Input:
    """What moves a joint: an actuator's command, or its effort where there is no actuator."""

    joint: int
    dof: int
    actuator: int | None
    drive: JointDrive | None


class FreeArm:
    """A model that runs freely.

    Args:
        path: MJCF.
        run: the recording.
        kind: which inputs are used; auto: commands of joints whose actuator has a command of its kind, else efforts.

    Raises:
        InputError: as `loaded_spec`; JOINT_MISSING when the model has none of the joints; UNSUPPORTED for a joint that
            nothing drives, a free base, and a model that cannot do without its other joints.
    """

    def __init__(self, path: Path, run: RecordedRun, kind: InputKind = "auto") -> None:
        self._mujoco, self.path, self.run, self.notes = imported_mujoco(), path, run, list[str]()
        described = read_simulator_model(path)
        self.notes += [f"left out: {each}" for each in described.left_out]
        if described.kind != "mjcf":
            raise InputError(ErrorCode.UNSUPPORTED, f"{path}: free runs need a model of MuJoCo (MJCF)")
        self.joints = tuple(name for name in run.names if name in described.joints)
        _check_names(run.names, tuple(described.joints), path)
        self._columns = [run.names.index(name) for name in self.joints]
        self.model = self._compiled()
        found = [self.model.joint(name) for name in self.joints]
        self._places = [int(each.qposadr[0]) for each in found]
        self._rates = [int(each.dofadr[0]) for each in found]
        self._inputs = [self._input(name, described.drives.get(name), kind) for name in self.joints]
        self._wrench = self._sensor(run.frame)
        self._data = [self._mujoco.MjData(self.model) for _ in range(max(os.cpu_count() or 1, 1))]

    @property
    def driven(self) -> dict[str, str]:
        """By joint: what moves it."""
        return {
            self.run.names[each.joint]: "effort" if each.drive is None else f"{each.drive.kind} command"
            for each in self._inputs
        }

    def _compiled(self) -> Any:
        """The model without its other joints, and what refers to them."""
        spec, _, _ = loaded_spec(self.path)
        kinds = self._mujoco.mjtJoint
        lost = [joint for joint in spec.joints if joint.name not in self.joints]
        names = {joint.name for joint in lost}
        for joint in lost:
            if joint.type == kinds.mjJNT_FREE and any(self._carries(joint.parent, name) for name in self.joints):
                raise InputError(
                    ErrorCode.UNSUPPORTED,
                    f"{self.path}: the base floats on the joint {joint.name}; fix it to the world",
                )
        referring = [each for each in spec.actuators if each.target in names]
        referring += [each for each in spec.equalities if {each.name1, each.name2} & names]
        referring += [each for each in spec.sensors if {each.objname, each.refname} & names]
        kept = {each.name for each in spec.actuators if each not in referring}
        referring += [each for each in spec.sensors if each.objname and _on_actuator(self._mujoco, each, kept)]
        for each in [*referring, *spec.keys, *lost]:
            spec.delete(each)
        for actuator in spec.actuators:  # delays are those of the commands: `_commands`
            if getattr(actuator, "delay", 0.0):
                actuator.delay, actuator.nsample = 0.0, 0
        if lost:
            self.notes.append(f"joints that were not recorded are held: {', '.join(sorted(filter(None, names)))}")
        try:
            return spec.compile()
        except (ValueError, self._mujoco.FatalError) as error:
            raise InputError(
                ErrorCode.UNSUPPORTED,
                f"{self.path}: it cannot be compiled without the joints that were not recorded "
                f"({', '.join(sorted(names))}): {' '.join(str(error).split())}; record their states too",
            ) from error

    def _carries(self, body: Any, joint: str) -> bool:
        return any(each.name == joint for each in body.find_all("joint"))

    def _input(self, name: str, drive: JointDrive | None, kind: InputKind) -> _Input:
        column, dof = self.run.names.index(name), int(self.model.joint(name).dofadr[0])
        actuators = [
            a
            for a in range(self.model.nu)
            if self.model.actuator_trntype[a] == int(self._mujoco.mjtTrn.mjTRN_JOINT)
            and self.model.actuator_trnid[a][0] == self.model.joint(name).id
        ]
        if kind != "efforts" and drive is not None and len(actuators) == 1 and self._commanded(drive, column):
            return _Input(column, dof, actuators[0], drive)
        for a in actuators:  # the recorded effort is all that moves the joint
            self.model.actuator_gainprm[a], self.model.actuator_biasprm[a] = 0.0, 0.0
        if kind == "commands" or not np.isfinite(self.run.effort[:, column]).any():
            what = "a single linear actuator and recorded commands of its kind"
            raise InputError(
                ErrorCode.UNSUPPORTED,
                f"{self.path}: nothing drives the joint {name}: it needs {what}, or recorded efforts; record"
                " joint_commands or efforts, or give the model a <position> actuator",
            )
        return _Input(column, dof, None, None)

    def _commanded(self, drive: JointDrive, column: int) -> bool:
        """Whether the recording has what an actuator takes."""
        if not len(self.run.command_seconds):
            return False
        sent = {"position": self.run.command, "velocity": self.run.command_velocity}.get(drive.kind)
        return sent is not None and bool(np.isfinite(sent[:, column]).all())

    def _sensor(self, frame: str | None) -> tuple[int, int] | None:
        """Addresses of the force and torque at the site of the recorded sensor, or at the only one."""
        found: dict[str, dict[str, int]] = {}
        kinds = {int(self._mujoco.mjtSensor.mjSENS_FORCE): "force", int(self._mujoco.mjtSensor.mjSENS_TORQUE): "torque"}
        for s in range(self.model.nsensor):
            what = kinds.get(int(self.model.sensor_type[s]))
            if what is not None:
                site = self.model.site(int(self.model.sensor_objid[s])).name
                found.setdefault(site, {})[what] = int(self.model.sensor_adr[s])
        sites = [site for site, both in found.items() if len(both) == 2 and (site == frame or len(found) == 1)]
        return (found[sites[0]]["force"], found[sites[0]]["torque"]) if sites and self.run.wrench is not None else None

    @property
    def drives(self) -> tuple[JointDrive | None, ...]:
        """(J) the drives that take recorded commands; None where efforts move the joint."""
        return tuple(each.drive for each in self._inputs)

    def recorded(self, seconds: Array) -> Array:
        """(..., J) the recorded positions of `joints`."""
        return self.run.position_at(seconds)[..., self._columns]

    def drive_values(self) -> dict[str, Array]:
        """By name, (J) values of the drives and of the joints behind them; NaN without a drive."""
        drives = [each.drive or JointDrive("", "effort", np.nan, delay=np.nan) for each in self._inputs]
        return {
            "gain": np.array([each.gain * each.gear**2 for each in drives]),
            "rate_gain": np.array([each.damping * each.gear**2 for each in drives]),
            "delay": np.array([each.delay for each in drives]),
            "damping": np.array(self.model.dof_damping[self._rates], dtype=np.float64),
            "armature": np.array(self.model.dof_armature[self._rates], dtype=np.float64),
            "friction": np.array(self.model.dof_frictionloss[self._rates], dtype=np.float64),
        }

    def set_drives(self, values: Mapping[str, Array]) -> None:
        """Give position drives other values, as `drive_values` has them."""
        joints = {"damping": "dof_damping", "armature": "dof_armature", "friction": "dof_frictionloss"}
        for name, array in joints.items():
            if name in values:
                getattr(self.model, array)[self._rates] = values[name]
        for j, each in enumerate(self._inputs):
            if each.drive is None or each.actuator is None:
                continue
            gain = float(values["gain"][j]) / each.drive.gear**2 if "gain" in values else each.drive.gain
            delay = float(values["delay"][j]) if "delay" in values else each.drive.delay
            self.model.actuator_gainprm[each.actuator][0] = gain
            rate = float(values["rate_gain"][j]) / each.drive.gear**2 if "rate_gain" in values else each.drive.damping
            self.model.actuator_biasprm[each.actuator][1:3] = -gain, -rate
            self._inputs[j] = replace(
                each, drive=replace(each.drive, gain=gain, stiffness=gain, damping=rate, delay=delay)
            )
        self._mujoco.mj_setConst(self.model, self._mujoco.MjData(self.model))

    @property
    def feels(self) -> bool:
        """Whether a wrench is simulated."""
        return self._wrench is not None

    def positions(self, starts: Array, horizon: float) -> tuple[Array, Array, Array]:
        """Free runs from the recorded states at `starts` (W,), s.

        Returns:
            (T,) s since the start; (W, T, J) rad or m of `joints`, NaN after a run has diverged; (W, T, 6) wrenches of
            the load on the sensor, NaN without one.
        """
        step = float(self.model.opt.timestep)
        steps = max(round(horizon / step), 1)
        every = max(round(_KEPT / step), 1)
        rows = np.arange(every - 1, steps, every)
        if not len(rows) or rows[-1] != steps - 1:
            rows = np.append(rows, steps - 1)
        size = self._mujoco.mj_stateSize(self.model, self._mujoco.mjtState.mjSTATE_FULLPHYSICS)
        together = max(_MOST_NUMBERS // (steps * (size + self.model.nu + self.model.nv)), 1)
        parts = [self._run(part, steps, rows) for part in np.array_split(starts, -(-len(starts) // together))]
        position, wrench = (np.concatenate(each).astype(np.float64) for each in zip(*parts, strict=True))
        return np.asarray((rows + 1) * step, dtype=np.float64), position, wrench

    def _run(self, starts: Array, steps: int, rows: Indices) -> tuple[Array, Array]:
        from mujoco import rollout  # with MuJoCo, the extra `sim`

        states = self._mujoco.mjtState
        inputs = int(states.mjSTATE_CTRL) | int(states.mjSTATE_QFRC_APPLIED)
        first = np.array([self._state(start) for start in starts.tolist()])
        control = self._control(starts, steps)
        state, sensed = rollout.rollout(self.model, self._data[: len(starts)], first, control, control_spec=inputs)
        where = 1 + np.array(self._places)  # a state begins with the time
        position = np.array(state[:, rows][:, :, where])
        gone = np.maximum.accumulate(~np.isfinite(position).all(axis=2) | (np.abs(position) > 1e3).any(axis=2), axis=1)
        position[gone] = np.nan
        wrench = np.full((*position.shape[:2], 6), np.nan)
        if self._wrench is not None:
            for part, address in enumerate(self._wrench):
                wrench[:, :, 3 * part : 3 * part + 3] = -sensed[:, rows, address : address + 3]
            wrench[gone] = np.nan
        return position, wrench

    def _state(self, start: float) -> Array:
        """The state of the simulation at the recorded one."""
        data, states = self._mujoco.MjData(self.model), self._mujoco.mjtState
        at = np.array(start)
        data.qpos[self._places] = self.run.position_at(at)[self._columns]
        data.qvel[self._rates] = self.run.velocity_at(at)[self._columns]
        for each in self._inputs:
            if each.drive is not None and each.drive.time_constant > 0.0 and each.actuator is not None:
                data.act[self.model.actuator_actadr[each.actuator]] = self._filtered(each, each.drive, start)
        state = np.empty(self._mujoco.mj_stateSize(self.model, states.mjSTATE_FULLPHYSICS))
        self._mujoco.mj_getState(self.model, data, state, states.mjSTATE_FULLPHYSICS)
        return state

    def _filtered(self, each: _Input, drive: JointDrive, start: float) -> float:
        """What the first-order filter of an actuator holds at a time."""
        step = min(drive.time_constant / 10.0, 0.01)
        at = np.arange(max(start - _LONGEST_DELAY, float(self.run.command_seconds[0])), start, step)
        held = float(self._commands(each, drive, np.array([start]))[0])
        if len(at):
            sent = self._commands(each, drive, at)
            held = float(sent[0])
            for value in sent.tolist():
                held += (value - held) * (1.0 - np.exp(-step / drive.time_constant))
        return held

    def _commands(self, each: _Input, drive: JointDrive, seconds: Array) -> Array:
        return self.run.command_at(seconds - drive.delay, each.joint, drive.kind == "velocity")

    def _control(self, starts: Array, steps: int) -> Array:
        """(W, steps, nu + nv) commands of actuators and applied efforts, at the middle of each step."""
        seconds = starts[:, None] + (np.arange(steps) + 0.5) * float(self.model.opt.timestep)
        control = np.zeros((*seconds.shape, self.model.nu + self.model.nv))
        for each in self._inputs:
            if each.drive is not None and each.actuator is not None:
                control[..., each.actuator] = self._commands(each, each.drive, seconds)
            else:
                control[..., self.model.nu + each.dof] = self.run.effort_at(seconds, each.joint)
        return control


def _check_names(recorded: Sequence[str], there: Sequence[str], path: Path) -> None:
    if set(recorded) & set(there):
        return
    pairs = [f"{name} ~ {near[0]}" for name in recorded if (near := get_close_matches(name, there, 1, 0.4))]
    alike = f"; alike: {', '.join(pairs)}" if pairs else ""
    raise InputError(
        ErrorCode.JOINT_MISSING,
        f"{path} has none of the recorded joints {' '.join(recorded)}; it has {' '.join(there)}{alike}",
    )


def _on_actuator(mujoco: Any, sensor: Any, kept: set[str]) -> bool:
    return bool(sensor.objtype == mujoco.mjtObj.mjOBJ_ACTUATOR and sensor.objname not in kept)
