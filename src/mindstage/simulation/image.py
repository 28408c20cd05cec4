"""Images of simulations: all that is needed to make equal ones, also in another process."""

from __future__ import annotations

import pickle
from typing import Any
from uuid import uuid4

from mindstage.engines.base import AssumingEngine
from mindstage.errors import ImaginationError
from mindstage.simulation.simulation import Simulation

__all__ = ["SimulationImage"]


class SimulationImage:
    """The state of a simulation at one time, from which any number of equal simulations can be made.

    In the process of the original each one costs a fork of the engine. A pickled image contains the engine's exact
    state, the geometry and the knowledge base, and is unpacked once.
    """

    def __init__(self, template: Simulation, *, earlier_notes: tuple[str, ...] = ()) -> None:
        """See `capture`; the notes are those of the copy that was captured, if it was one."""
        self.key = uuid4().hex
        """Identifies the image, in all processes."""
        self._template: Simulation | None = template
        self._pickled = b""
        self._earlier_notes = earlier_notes

    @classmethod
    def capture(cls, simulation: Simulation) -> SimulationImage:
        """The image of the current state of a simulation, which may continue to run; without physics, in MuJoCo."""
        earlier = simulation.origin.notes if simulation.origin is not None else ()
        return cls(simulation.fork(threaded=False, physics=True), earlier_notes=earlier)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the image does not have in common with the original, one sentence each."""
        origin = self._unpacked().origin
        return (*self._earlier_notes, *(origin.notes if origin is not None else ()))

    @property
    def assumptions(self) -> tuple[str, ...]:
        """What its engine assumes, one sentence each."""
        return self._unpacked().engine.run(
            lambda engine: engine.assumptions if isinstance(engine, AssumingEngine) else ()
        )

    def restore(self, *, threaded: bool = False) -> Simulation:
        """Makes a simulation in exactly this state; the caller closes it.

        Args:
            threaded: see `Simulation.fork`. Without a thread, `restore` and its results are used in one thread only.
        """
        return self._unpacked().fork(threaded=threaded)

    def close(self) -> None:
        """Releases the state; simulations that were made from it remain."""
        if self._template is not None:
            self._template.close()

    def _unpacked(self) -> Simulation:
        if self._template is None:
            self._template, self._pickled = pickle.loads(self._pickled), b""
        return self._template

    def __getstate__(self) -> dict[str, Any]:
        if not self._pickled:
            try:
                self._pickled = pickle.dumps(self._unpacked(), protocol=pickle.HIGHEST_PROTOCOL)
            except (pickle.PicklingError, TypeError, AttributeError) as error:
                raise ImaginationError(f"the simulation cannot be copied to another process: {error}") from error
        return {
            "key": self.key,
            "_template": None,
            "_pickled": self._pickled,
            "_earlier_notes": self._earlier_notes,
        }
