"""The world of a simulated robot with momentum, by the physics engine MuJoCo (extra `sim`)."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from poise.assembly import Assembly, RigidObject
from poise.errors import ErrorCode, InputError
from poise.fake_robots.grip import Pads
from poise.fake_robots.world import Hand, Held
from poise.geometry import Pose, quaternion_of_rotation, rotation_about
from poise.inertia import InertialParameters
from poise.worlds import mjcf_geom, mjcf_inertial, mjcf_place

_STEP = 0.002  # s
_THICKNESS = 0.012  # m of a finger
_PRESS = 0.02  # m by which the fingers are commanded beyond what they hold


class MujocoWorld:
    """Rigid bodies in contact; what is not convex is its convex hull.

    The hand and what the base carries follow their poses through stiff springs.

    Args:
        assembly, pads, riding: as of `QuasistaticWorld`.

    Raises:
        InputError: UNSUPPORTED when MuJoCo is not installed.
    """

    def __init__(self, assembly: Assembly, pads: Pads, riding: tuple[str, ...] = ()) -> None:
        try:
            import mujoco
        except ImportError as error:
            raise InputError(
                ErrorCode.UNSUPPORTED, "parameter world_engine: mujoco is not installed; pip install 'poise[sim]'"
            ) from error
        for name in riding:
            assembly.place_of(name)
        self._engine: Any = mujoco
        self._assembly, self._pads, self._riding = assembly, pads, riding
        self._model = mujoco.MjModel.from_xml_string(_mjcf(assembly, pads, riding))
        self.remarks: list[str] = []
        self._numbers = {item.id: i for i, item in enumerate(assembly.objects)}
        self.reset()

    def reset(self) -> None:
        """Be as at the beginning."""
        self._data = self._engine.MjData(self._model)
        self._before: tuple[Hand, ...] = ()  # the last two
        self._hold: tuple[str, float] = ("", 0.0)

    @property
    def objects(self) -> Mapping[str, RigidObject]:
        """All objects, at their poses in the world."""
        found = {}
        for item in self._assembly.objects:
            body = self._data.body(f"b{self._numbers[item.id]}")
            pose = item.pose if item.fixed and item.id not in self._riding else Pose(body.xmat.reshape(3, 3), body.xpos)
            found[item.id] = replace(item, pose=Pose(pose.rotation.copy(), pose.translation.copy()))
        return found

    def advance(self, hand: Hand) -> Held:
        """Go on to the time of the hand's state."""
        if not self._before:
            self._before = (hand, hand)
            self._first_base = hand.base
            self._put("hand", hand.tool, at_once=True)
        first, before = self._before
        self._before = (before, hand)
        steps = max(round((hand.time - before.time) / _STEP), 1)
        opening = hand.opening if not (self._hold[0] and hand.force > 0) else self._hold[1] - _PRESS
        for finger in (0, 1):
            self._data.ctrl[finger] = opening / 2
            self._model.actuator_forcerange[finger] = (-max(hand.force, 50.0), max(hand.force, 50.0))
        for share in np.arange(1, steps + 1) / steps:
            self._put("hand", _between(first.tool, before.tool, hand.tool, share))
            moved = _between(first.base, before.base, hand.base, share) @ self._first_base.inverse
            for name in self._riding:
                self._put(f"r{self._numbers[name]}", moved @ self._assembly.objects[self._numbers[name]].pose)
            self._engine.mj_step(self._model, self._data)
        return self._felt(hand)

    def _put(self, name: str, pose: Pose, at_once: bool = False) -> None:
        number = self._model.body(f"{name}_goal").mocapid[0]
        x, y, z, w = quaternion_of_rotation(pose.rotation)
        self._data.mocap_pos[number], self._data.mocap_quat[number] = pose.translation, (w, x, y, z)
        if at_once:
            start = self._model.joint(f"{name}_free").qposadr[0]
            self._data.qpos[start : start + 7] = [*pose.translation, w, x, y, z]

    def _felt(self, hand: Hand) -> Held:
        touches: dict[int, set[int]] = {}
        reaction, point = np.zeros(3), np.zeros(3)
        fingers = [self._model.body(f"finger{i}").id for i in (0, 1)]
        contacts = [(c, [int(self._model.geom_bodyid[g]) for g in c.geom]) for c in self._data.contact]
        for _, bodies in contacts:
            for finger, other in (bodies, bodies[::-1]):
                if finger in fingers:
                    touches.setdefault(other, set()).add(finger)
        gripped = [item for item in self._assembly.objects if not item.fixed]
        gripped = [item for item in gripped if len(touches.get(self._body(item.id), ())) == 2]
        if not gripped:
            self._hold = ("", 0.0)
            return Held(hand.time)
        item = self.objects[gripped[0].id]
        force = np.zeros(6)
        for number, (contact, bodies) in enumerate(contacts):
            if self._body(item.id) in bodies and not set(bodies) & set(fingers):
                self._engine.mj_contactForce(self._model, self._data, number, force)
                sign = 1.0 if bodies[1] == self._body(item.id) else -1.0
                reaction += sign * contact.frame.reshape(3, 3).T @ force[:3]
                point = contact.pos.copy()
        opening = 2 * float(np.mean([self._data.joint(f"slide{i}").qpos[0] for i in (0, 1)]))
        self._hold = (item.id, opening)
        about_com = hand.tool.rotation.T @ item.inertia_in_world @ hand.tool.rotation
        phi = InertialParameters(item.mass, hand.tool.undo(item.com_in_world), about_com).phi
        return Held(hand.time, item.id, max(opening, 0.0), phi, max(float(reaction[2]), 0.0), point)

    def _body(self, name: str) -> int:
        return int(self._model.body(f"b{self._numbers[name]}").id)


def _between(first: Pose, before: Pose, last: Pose, share: float) -> Pose:
    """A pose on the way from `before` to `last`; through `first` before, with a velocity that does not jump."""
    turn = before.rotation.T @ last.rotation
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine = float(np.linalg.norm(axis)) / 2
    angle = float(np.arctan2(sine, (np.trace(turn) - 1) / 2))
    partly = rotation_about(axis / (2 * sine), share * angle) if sine > 1e-12 else np.eye(3)
    steps = last.translation - before.translation, before.translation - first.translation
    curve = (steps[0] - steps[1]) / 2
    return Pose(before.rotation @ partly, before.translation + share * (steps[0] - curve) + share**2 * curve)


def _mjcf(assembly: Assembly, pads: Pads, riding: tuple[str, ...]) -> str:
    """The model."""
    shared = f'friction="{assembly.friction or 0.0} 0.005 0.0001" condim="4"'
    assets, bodies, goals, welds = [], [], [], []

    def follow(name: str, pose: Pose) -> None:
        goals.append(f'<body name="{name}_goal" mocap="true" {mjcf_place(pose)}/>')

    for i, item in enumerate(assembly.objects):
        geom, asset, _ = mjcf_geom(item, f"g{i}", shared, hull=True)
        assets.append(asset)
        inertial = joint = ""
        if item.id in riding:
            follow(f"r{i}", item.pose)
            welds.append(f'<weld body1="r{i}_goal" body2="b{i}" solref="0.004 1" solimp="0.99 0.999 0.001"/>')
            inertial, joint = '<inertial pos="0 0 0" mass="200" diaginertia="20 20 20"/>', "<freejoint/>"
        elif not item.fixed:
            inertial, joint = mjcf_inertial(item), "<freejoint/>"
        drifts = ' gravcomp="1"' if item.id in riding else ""
        bodies.append(f'<body name="b{i}" {mjcf_place(item.pose)}{drifts}>{joint}{inertial}{geom}</body>')
    follow("hand", Pose.identity())
    size = f"{pads.width / 2} {_THICKNESS / 2} {pads.length / 2}"
    fingers = "".join(
        f'<body name="finger{i}" gravcomp="1"><joint name="slide{i}" type="slide" axis="0 {sign} 0" range="-0.001 1" '
        'damping="400" armature="3"/>'
        f'<geom type="box" size="{size}" pos="0 {sign * _THICKNESS / 2} {-pads.length / 2}" mass="0.1" '
        f'friction="{pads.friction} 0.005 0.0001" condim="4" priority="1" solref="0.004 1"/></body>'
        for i, sign in enumerate((1, -1))
    )
    hand = (
        '<body name="hand" gravcomp="1"><freejoint name="hand_free"/>'
        f'<inertial pos="0 0 0" mass="5" diaginertia="0.1 0.1 0.1"/>{fingers}</body>'
    )
    welds.append('<weld body1="hand_goal" body2="hand" solref="0.004 1" solimp="0.99 0.999 0.001"/>')
    place = assembly.index
    pairs = "".join(
        f'<pair geom1="g{place[a]}" geom2="g{place[b]}" friction="{mu} {mu} 0.005 0.0001 0.0001" condim="4"/>'
        for (a, b), mu in ((pair.objects, pair.coefficient) for pair in assembly.friction_pairs)
    )
    motors = "".join(f'<position joint="slide{i}" kp="20000" forcerange="-100 100"/>' for i in (0, 1))
    gravity = " ".join(str(value) for value in assembly.gravity)
    return (
        f'<mujoco><option timestep="{_STEP}" gravity="{gravity}" integrator="implicitfast" cone="elliptic" '
        f'impratio="10"/><asset>{"".join(assets)}</asset><worldbody>{"".join(goals)}{"".join(bodies)}{hand}</worldbody>'
        f"<contact>{pairs}</contact><equality>{''.join(welds)}</equality><actuator>{motors}</actuator></mujoco>"
    )
