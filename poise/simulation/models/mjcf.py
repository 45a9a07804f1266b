"""MJCF: the bodies, joints, actuators and force sensors of a MuJoCo model, as MuJoCo compiles it.

https://mujoco.readthedocs.io/en/stable/XMLreference.html; values of classes, defaults and includes are those that
MuJoCo resolves.
"""

from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose, rotation_about, rotation_of_quaternion
from poise.inertia.model import InertialParameters
from poise.simulation.models.description import DriveKind, JointDrive, JointPhysics, SensorNoise, SimulatorModel
from poise.simulation.models.mjcf_loading import imported_mujoco, loaded_spec
from poise.simulation.models.urdf_text import LinkMotion, TreeBody, TreeJoint, urdf_of


def read_mjcf(path: Path) -> SimulatorModel:
    """A MuJoCo model.

    Raises:
        InputError: as `loaded_spec`; UNSUPPORTED for gravity that does not point down.
    """
    _, model, lost = loaded_spec(path)
    return _Mjcf(model, path, lost).described()


class _Mjcf:
    """A compiled model, read from the root downwards."""

    def __init__(self, model: Any, path: Path, lost: tuple[str, ...]) -> None:
        self._mujoco, self._model, self._path, self._lost = imported_mujoco(), model, path, list(lost)
        self._names = ["world", *(model.body(b).name or f"body_{b}" for b in range(1, model.nbody))]
        self._taken = set(self._names)

    def described(self) -> SimulatorModel:
        model, sensors = self._model, self._sensors()
        bodies = self._bodies({each.frame for each in sensors})
        joints = {self._joint(j): self._physics(j) for j in range(model.njnt) if self._moves(j)}
        drives = self._drives()
        self._note_the_rest()
        urdf = urdf_of(self._path.stem, bodies)
        return SimulatorModel(
            self._path, "mjcf", urdf, joints, drives, sensors, self._gravity(), tuple(dict.fromkeys(self._lost))
        )

    def _joint(self, j: int) -> str:
        return self._model.joint(j).name or f"joint_{j}"

    def _moves(self, j: int) -> bool:
        kinds = self._mujoco.mjtJoint
        return int(self._model.jnt_type[j]) in (int(kinds.mjJNT_HINGE), int(kinds.mjJNT_SLIDE))

    def _joints_of(self, b: int) -> range:
        return range(self._model.body_jntadr[b], self._model.body_jntadr[b] + self._model.body_jntnum[b])

    def _gravity(self) -> float:
        x, y, z = self._model.opt.gravity.tolist()
        if abs(x) + abs(y) > 1e-3 * abs(z) or z > 0.0:
            raise InputError(
                ErrorCode.UNSUPPORTED, f"{self._path}: gravity is {x:g} {y:g} {z:g}: turn the model so that z is up"
            )
        return -float(z)

    @cached_property
    def _robot(self) -> list[int]:
        """The bodies that joint states move, the root first: the world, or a free body that carries joints."""
        model, free = self._model, int(self._mujoco.mjtJoint.mjJNT_FREE)
        loose = {int(model.jnt_bodyid[j]) for j in range(model.njnt) if model.jnt_type[j] == free}
        moved = {int(model.jnt_bodyid[j]) for j in range(model.njnt) if self._moves(j)}
        for root in sorted(loose):
            found = self._below(root, loose - {root})
            if moved & set(found[1:]):
                return found
        return self._below(0, loose)

    def _below(self, root: int, without: set[int]) -> list[int]:
        found = [root]
        for b in range(root + 1, self._model.nbody):
            if int(self._model.body_parentid[b]) in found and b not in without:
                found.append(b)
        return found

    def _bodies(self, sensing: set[str]) -> list[TreeBody]:
        """The links; a force sensor's site is one between the joint and its body, since it feels the whole body."""
        root, *others = self._robot
        found = [TreeBody(self._names[root], None, Pose.identity(), None, self._inertial(root) if root else None)]
        found += self._sites(root, ())
        for b in others:
            pose = Pose(rotation_of_quaternion(np.roll(self._model.body_quat[b], -1)), self._model.body_pos[b].copy())
            felt = [s for s in range(self._model.nsite) if self._model.site_bodyid[s] == b and self._site(s) in sensing]
            made = self._jointed(b, self._names[self._model.body_parentid[b]], pose, bool(felt))
            if felt:
                place = self._site_pose(felt[0])
                made += [TreeBody(self._site(felt[0]), made[-1].name, place)]
                made += [TreeBody(self._names[b], self._site(felt[0]), place.inverse)]
            found += [*made[:-1], replace(made[-1], inertial=self._inertial(b)), *self._sites(b, felt[:1])]
        return found

    def _jointed(self, b: int, parent: str, pose: Pose, apart: bool) -> list[TreeBody]:
        """Links from the parent to a body, one for each joint, which turns about its own point of the body.

        Args:
            b: the body.
            parent: the link that it hangs on.
            pose: of the body in its parent where every joint is at its reference.
            apart: end with a link of its own for the mount of a sensor.
        """
        made: list[TreeBody] = []
        place = pose
        for j in (each for each in self._joints_of(b) if self._moves(each)):
            at = Pose(np.eye(3), self._model.jnt_pos[j].copy())
            joint = self._tree_joint(j)
            back = _at_zero(joint, float(self._model.qpos0[self._model.jnt_qposadr[j]]))
            name = self._fresh(f"{self._names[b]}__{joint.name}")
            made.append(TreeBody(name, made[-1].name if made else parent, place @ at @ back, joint))
            place = at.inverse
        name = self._fresh(f"{self._names[b]}__mount") if apart else self._names[b]
        if made and not np.any(place.translation):
            return [*made[:-1], replace(made[-1], name=name)]
        return [*made, TreeBody(name, made[-1].name if made else parent, place)]

    def _tree_joint(self, j: int) -> TreeJoint:
        slides = self._model.jnt_type[j] == int(self._mujoco.mjtJoint.mjJNT_SLIDE)
        limited = bool(self._model.jnt_limited[j])
        lower, upper = self._model.jnt_range[j].tolist() if limited else (-1e3, 1e3)
        axis = self._model.jnt_axis[j].copy()
        kind: LinkMotion = "prismatic" if slides else "revolute" if limited else "continuous"
        return TreeJoint(self._joint(j), kind, axis, lower, upper, self._follows(j))

    def _follows(self, j: int) -> tuple[str, float, float] | None:
        """A linear equality makes a joint follow another one: y - y0 = a0 + a1 (x - x0)."""
        model = self._model
        for e in range(model.neq):
            linked = model.eq_type[e] == int(self._mujoco.mjtEq.mjEQ_JOINT) and model.eq_active0[e]
            if linked and model.eq_obj1id[e] == j and model.eq_obj2id[e] >= 0 and not model.eq_data[e][2:5].any():
                other, (a0, a1) = int(model.eq_obj2id[e]), model.eq_data[e][:2].tolist()
                at, there = (float(model.qpos0[model.jnt_qposadr[k]]) for k in (j, other))
                return self._joint(other), a1, at + a0 - a1 * there
        return None

    def _inertial(self, b: int) -> InertialParameters | None:
        mass = float(self._model.body_mass[b])
        if mass <= 0.0:
            return None
        turned = rotation_of_quaternion(np.roll(self._model.body_iquat[b], -1))
        inertia = turned @ np.diag(self._model.body_inertia[b]) @ turned.T
        return InertialParameters(mass, self._model.body_ipos[b].copy(), inertia)

    def _site(self, s: int) -> str:
        return self._model.site(s).name or f"site_{s}"

    def _site_pose(self, s: int) -> Pose:
        return Pose(rotation_of_quaternion(np.roll(self._model.site_quat[s], -1)), self._model.site_pos[s].copy())

    def _sites(self, b: int, but: list[int] | tuple[()]) -> list[TreeBody]:
        there = [s for s in range(self._model.nsite) if self._model.site_bodyid[s] == b and s not in but]
        return [TreeBody(self._fresh(self._site(s)), self._names[b], self._site_pose(s)) for s in there]

    def _fresh(self, name: str) -> str:
        """A name that no link has."""
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        return name

    def _physics(self, j: int) -> JointPhysics:
        model, dof, name = self._model, self._model.jnt_dofadr[j], self._joint(j)
        for what in ("dof_dampingpoly", "jnt_stiffnesspoly"):
            if np.any(getattr(model, what, np.zeros((model.nv, 1)))[dof if what.startswith("dof") else j]):
                self._lost.append(f"the non-linear {'damping' if what.startswith('dof') else 'spring'} of {name}")
        armature, damping = float(model.dof_armature[dof]), float(model.dof_damping[dof])
        for a in self._actuators_of(j):  # since MuJoCo 3.10, drives bring rotors and damping of their own
            gear = float(model.actuator_gear[a][0]) ** 2
            armature += gear * float(getattr(model, "actuator_armature", np.zeros(model.nu))[a])
            damping += gear * float(getattr(model, "actuator_damping", np.zeros(model.nu))[a])
        stiffness, rest = float(model.jnt_stiffness[j]), float(model.qpos_spring[model.jnt_qposadr[j]])
        friction = float(model.dof_frictionloss[dof])
        ramp, lead = self._softness(dof, friction) if friction else (0.0, 0.0)
        return JointPhysics(friction, damping, armature, stiffness, rest if stiffness else 0.0, ramp, lead)

    def _softness(self, dof: int, friction: float) -> tuple[float, float]:
        """Ramp and lead of dry friction, a constraint at velocity level ("Computation" of MuJoCo's manual)."""
        model = self._model
        reference, impedance = model.dof_solref[dof], np.clip(model.dof_solimp[dof][:2], 1e-4, 0.9999)
        if reference[0] > 0.0:
            safe = not model.opt.disableflags & int(self._mujoco.mjtDisableBit.mjDSBL_REFSAFE)
            span = max(float(reference[0]), 2.0 * float(model.opt.timestep)) if safe else float(reference[0])
            lead = 0.5 * span * float(impedance[1])
        else:
            lead = float(impedance[1]) / max(-float(reference[1]), 1e-9)
        light = float(model.dof_invweight0[dof]) * (1.0 - float(impedance[0])) / float(impedance[0])
        return friction * light * lead, lead

    def _actuators_of(self, j: int) -> list[int]:
        model, on_joint = self._model, int(self._mujoco.mjtTrn.mjTRN_JOINT)
        return [a for a in range(model.nu) if model.actuator_trntype[a] == on_joint and model.actuator_trnid[a][0] == j]

    def _drives(self) -> dict[str, JointDrive]:
        found: dict[str, JointDrive] = {}
        for j in (each for each in range(self._model.njnt) if self._moves(each)):
            made = [self._drive(a, j) for a in self._actuators_of(j)]
            if len(made) == 1 and made[0] is not None:
                found[self._joint(j)] = made[0]
            elif made:
                self._lost.append(f"the actuators of {self._joint(j)}, which are no single linear drive")
        return found

    def _drive(self, a: int, j: int) -> JointDrive | None:
        model, mujoco = self._model, self._mujoco
        gain, bias = model.actuator_gainprm[a], model.actuator_biasprm[a]
        unbiased, affine = int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)
        direct, *filters = (int(getattr(mujoco.mjtDyn, f"mjDYN_{name}")) for name in ("NONE", "FILTER", "FILTEREXACT"))
        linear = model.actuator_gaintype[a] == int(mujoco.mjtGain.mjGAIN_FIXED)
        filtered = int(model.actuator_dyntype[a]) in filters
        if not linear or int(model.actuator_biastype[a]) not in (unbiased, affine) or bias[0]:
            return None
        if not (filtered or model.actuator_dyntype[a] == direct):
            return None
        if model.actuator_biastype[a] == unbiased:
            bias = np.zeros(3)
        kind: DriveKind = "position" if bias[1] else "velocity" if bias[2] else "effort"
        low, high = -np.inf, np.inf
        if model.actuator_forcelimited[a]:
            low, high = model.actuator_forcerange[a].tolist()
        if model.jnt_actfrclimited[j]:
            of_joint = model.jnt_actfrcrange[j] / model.actuator_gear[a][0]
            low, high = max(low, float(of_joint.min())), min(high, float(of_joint.max()))
        return JointDrive(
            model.actuator(a).name,
            kind,
            float(gain[0]),
            -float(bias[1]),
            -float(bias[2]),
            float(model.actuator_gear[a][0]),
            float(getattr(model, "actuator_delay", np.zeros(model.nu))[a]),
            float(model.actuator_dynprm[a][0]) if filtered else 0.0,
            (low, high),
        )

    def _sensors(self) -> tuple[SensorNoise, ...]:
        """Sites with a force sensor, and with their torque sensors."""
        model, kinds = self._model, self._mujoco.mjtSensor
        forces, torques = (
            {
                self._site(int(model.sensor_objid[s])): float(model.sensor_noise[s])
                for s in range(model.nsensor)
                if model.sensor_type[s] == int(kind)
            }
            for kind in (kinds.mjSENS_FORCE, kinds.mjSENS_TORQUE)
        )
        return tuple(SensorNoise(site, noise, torques.get(site, 0.0)) for site, noise in forces.items())

    def _note_the_rest(self) -> None:
        model = self._model
        if model.ntendon:
            self._lost.append("tendons")
        if np.any(model.body_gravcomp):
            self._lost.append("gravcomp, which the efforts of a robot contain or not")
        if model.opt.wind.any() or model.opt.density or model.opt.viscosity:
            self._lost.append("wind and fluid")


def _at_zero(joint: TreeJoint, reference: float) -> Pose:
    """Where the joint is at zero, from where it is at its reference."""
    if joint.kind == "prismatic":
        return Pose(np.eye(3), -reference * joint.axis)
    return Pose(rotation_about(joint.axis, -reference), np.zeros(3))
