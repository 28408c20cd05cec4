"""Guesses: masses and frictions that no map states, by how much they may be wrong, and which of them matters.

The true value of a guess is the guess times a log-normal factor, whose logarithm has this standard deviation:

| guess | spread | true in 90 % | from |
|---|---|---|---|
| mass, estimated from the volume | 1.0 | 0.19 to 5.2 times | the masses in generated homes (`mindstage.homes`) |
| friction, that of a material or 0.8 | 0.6 | 0.37 to 2.7 times | published ranges (`mindstage.homes.friction`) |
| friction of a slide, which just holds it in place | 1.3 | 0.12 to 8.5 times | the same |
| friction of a hinge, which just holds it in place | 2.8 | 0.01 to 100 times | the same |

The true value lies in it for at least nine of ten things of generated homes whose maps state neither masses nor
frictions. Hinges differ most: some have nothing but the friction of their pins, others have a seal or a closer, up to
the 22 N that standards permit.

The factor of friction is one for all bodies of a sample, since a contact has one coefficient and engines take the
larger one of two bodies; masses and joints have one each.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from mindstage.scene import AxisMotion, BodyId
from mindstage.scene.display import counted
from mindstage.scene.joint_kinematics import RigidGroups, moving_body
from mindstage.simulation import Simulation

__all__ = ["Guess", "GuessKind", "Guesses"]


class GuessKind(StrEnum):
    """What is guessed."""

    MASS = "mass"
    FRICTION = "friction"
    JOINT_FRICTION = "joint friction"


class Guess(NamedTuple):
    """One guess."""

    kind: GuessKind
    body: BodyId | None = None
    """Whose mass, or what the joint moves; None for the friction of all bodies."""
    is_hinge: bool = False
    """Whether the joint only turns."""

    @property
    def spread(self) -> float:
        """The standard deviation of the logarithm of the factor between the guess and the true value."""
        if self.kind is GuessKind.JOINT_FRICTION:
            return 2.8 if self.is_hinge else 1.3
        return 0.6 if self.kind is GuessKind.FRICTION else 1.0

    def __str__(self) -> str:
        return f"the {self.kind}" if self.body is None else f"the {self.kind} of {self.body}"


@dataclass(frozen=True, slots=True)
class Guesses:
    """What is guessed in a world."""

    bodies: tuple[BodyId, ...] = ()
    """All bodies but those of robots, whose frictions are guesses."""
    masses: tuple[BodyId, ...] = ()
    """The loose and jointed bodies without a mass."""
    joints: tuple[BodyId, ...] = ()
    """The bodies that joints move."""
    hinged: frozenset[BodyId] = frozenset()
    """Those of them that only turn."""

    @classmethod
    def of(cls, simulation: Simulation) -> Guesses:
        """The guesses about the current world of a simulation."""
        world = simulation.snapshot()
        robots = {id for robot in simulation.robots.values() for id in robot.body_ids}
        groups = RigidGroups.from_world(world)
        rows = {row for row, body in enumerate(world.bodies) if body.id not in robots}
        bodies = {body.id: body for body in world.bodies}
        turned = (
            moving_body(joint, bodies[joint.parent], bodies[joint.child])[0].id
            for joint in world.joints
            if all(axis is AxisMotion.LOCKED for axis in (joint.linear.x, joint.linear.y, joint.linear.z))
        )
        moving = [row for row in sorted(rows) if groups.is_dynamic[groups.root_row[row]]]
        return cls(
            bodies=tuple(world.bodies[row].id for row in sorted(rows)),
            masses=tuple(world.bodies[row].id for row in moving if not world.bodies[row].physics.mass_kg),
            joints=tuple(
                world.bodies[row].id for row in moving if groups.is_jointed[row] and groups.root_row[row] == row
            ),
            hinged=frozenset(turned),
        )

    def all(self) -> tuple[Guess, ...]:
        """All guesses, in the order of their random numbers."""
        return (
            *([Guess(GuessKind.FRICTION)] if self.bodies else []),
            *(Guess(GuessKind.MASS, id) for id in self.masses),
            *(Guess(GuessKind.JOINT_FRICTION, id, id in self.hinged) for id in self.joints),
        )

    def numbers(self, seed: int, index: int) -> dict[Guess, float]:
        """The standard normal number of each guess in a sample, which does not depend on what else is uncertain."""
        guesses = self.all()
        values = np.random.default_rng([seed, index, 1]).standard_normal(len(guesses))
        return dict(zip(guesses, values.tolist(), strict=True))

    def factors(
        self, seed: int, index: int, fixed: Collection[Guess] = ()
    ) -> Mapping[BodyId, Mapping[GuessKind, float]]:
        """The factors of each body in a sample.

        Args:
            seed: the seed of all samples.
            index: the number of the sample.
            fixed: guesses that are exactly true.
        """
        found: dict[BodyId, dict[GuessKind, float]] = {}
        for guess, number in self.numbers(seed, index).items():
            if guess not in fixed:
                for id in self.bodies if guess.body is None else (guess.body,):
                    found.setdefault(id, {})[guess.kind] = float(np.exp(guess.spread * number))
        return found

    def sentences(self, named: Collection[BodyId], *, only_named: bool = False) -> Iterator[str]:
        """What is guessed, one sentence for each kind; those that are named are listed, others counted or left out."""
        for kind, ids, how in (
            (GuessKind.MASS, self.masses, "estimated from the volume"),
            (GuessKind.FRICTION, self.bodies, "that of a material, or 0.8"),
            (GuessKind.JOINT_FRICTION, self.joints, "just enough to hold the joint in place"),
        ):
            listed = [id for id in ids if id in named]
            others = counted(len(ids) - len(listed), "body")
            about = [*listed, others] if len(ids) > len(listed) and not only_named else listed
            if about:
                yield f"the {kind} of {' and '.join(about)} is a guess: {how}"
