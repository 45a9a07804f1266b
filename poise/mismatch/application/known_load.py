"""The load of a model with its covariance, as an object of an assembly on a base."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.inertia.model import InertialParameters, frame_change
from poise.mismatch.effects import PAYLOAD_PARAMETERS
from poise.mismatch.inference import payload_steps
from poise.mismatch.reading import NominalModel
from poise.types import Array

if TYPE_CHECKING:  # the assembly engine takes longer to load than a short diagnosis computes
    from poise.assembly import RigidObject

_CAUTION = 2.0
"""Sigmas by which mass and centre of mass are varied; those of a stated payload reach its tolerances."""


def known_load(model: NominalModel) -> tuple[Array, Array]:
    """(10,) phi of the payload, sensor axes, and its covariance (10, 10).

    The payload that a diagnosis found, with its covariance; else the stated one, with half its tolerances as sigmas.

    Raises:
        InputError: BAD_INPUT for a model without a payload.
    """
    if model.phi is None:
        raise InputError(ErrorCode.BAD_INPUT, "the model has no payload: state one, or save a diagnosis of a recording")
    steps = payload_steps(model.phi, model.tolerance) / _CAUTION
    found = model.effect("payload_parameters")
    if found is None:
        return model.phi, np.asarray(steps @ steps.T)
    order = [list(found.values).index(name) for name in PAYLOAD_PARAMETERS]
    return model.phi + np.array([found.values[name] for name in PAYLOAD_PARAMETERS]), found.covariance[
        np.ix_(order, order)
    ]


def loads_about(item: "RigidObject", model: NominalModel, pose_sensor_object: Pose) -> "list[RigidObject]":
    """The object with the load of the model, then its sigma points: one each way along every axis of
    the covariance of mass and first moment (Julier and Uhlmann 2004), at `_CAUTION` sigmas.

    Args:
        item: of an assembly; its mass, centre of mass and inertia are replaced.
        model: see `known_load`.
        pose_sensor_object: of the object's frame, in the sensor's.

    Raises:
        InputError: as `known_load`; OBJECT_INVALID when the model's payload is no body.
    """
    phi, covariance = known_load(model)
    rotation = pose_sensor_object.rotation
    change = frame_change(rotation.T, -rotation.T @ pose_sensor_object.translation)
    phi, covariance = change @ phi, change @ covariance @ change.T
    strength, axes = np.linalg.eigh(covariance[:4, :4])
    steps = _CAUTION * np.sqrt(np.maximum(strength, 0.0)) * axes
    body = InertialParameters.from_phi(phi)
    made = []
    for step in (np.zeros(4), *steps.T, *-steps.T):
        mass = max(float(phi[0] + step[0]), 1e-6)
        com = (phi[1:4] + step[1:]) / mass
        made.append(replace(item, mass=mass, com=com, inertia=body.inertia, covariance=covariance))
    return made
