"""The Plan panel: tries plans in copies of the simulation, and shows the outcome as ghosts in the view.

One plan at a time runs, in a thread of its own, for all pages; they share the result and the ghosts.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Annotated, Any

import msgspec
from msgspec import Meta
from msgspec.structs import replace

from mindstage.access.limits import PLAN_CHARACTERS
from mindstage.access.policies import READ, RUN, SPAWN
from mindstage.access.resources import without_paths
from mindstage.errors import InvalidArgumentError, MindstageError
from mindstage.imagination import Place, PlanFile, Progress, Verdict, act, evaluate_plan, validate_plan
from mindstage.imagination.acting import is_changed
from mindstage.imagination.trials import physical_simulation, plan_from_text
from mindstage.rdf.graphs import local_name
from mindstage.rendering.appearance import BodyAppearance, compute_appearance
from mindstage.scene import BodyId, Vector, World
from mindstage.scene.colors import hex_color
from mindstage.scene.display import counted
from mindstage.simulation import Simulation, StateSnapshot
from mindstage.simulation.observation import as_client
from mindstage.viewer.ghosts import (
    GhostGroup,
    GhostNodes,
    ImaginationGhosts,
    ReplayGhosts,
    end_pose_ghosts,
    trail_ghosts,
)
from mindstage.viewer.server import CLIENT, ClientSession, EmptyRequest, RpcChannel

__all__ = ["PlanHandler"]

_TOPIC = "plan"
_END_POSES, _REPLAY = "end poses", "replay"


class EvaluatePlanRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `plan.evaluate`."""

    plan: Annotated[str, Meta(max_length=PLAN_CHARACTERS.count)]
    """JSON or YAML."""
    samples: Annotated[int, Meta(ge=1, le=100_000)] = 100
    seed: Annotated[int, Meta(ge=0, le=2**53)] = 0
    workers: Annotated[int, Meta(ge=1, le=64)] = 1
    threshold: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.9
    budget_s: Annotated[float, Meta(gt=0.0, le=600.0)] = 60.0


class ActRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `plan.act`."""

    plan: Annotated[str, Meta(max_length=PLAN_CHARACTERS.count)]
    """JSON or YAML."""


class ShowCopiesRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `plan.show_copies`."""

    shown: bool


class PlanHandler:
    """Handles the requests `plan.…`, and publishes their state as the topic `plan`."""

    def __init__(self, simulation: Simulation, channel: RpcChannel, nodes: GhostNodes) -> None:
        """Registers the requests.

        Args:
            simulation: the simulation in whose copies plans are tried.
            channel: the channel of the pages.
            nodes: the nodes of ghosts, which only `update` uses.
        """
        self._simulation, self._channel, self._nodes = simulation, channel, nodes
        self._copies = ImaginationGhosts(nodes)
        self._lock = threading.Lock()
        self._cancel = threading.Event()
        self._thread: threading.Thread | None = None
        self._state: dict[str, object] = {"state": "idle"}
        self._layers: dict[str, tuple[GhostGroup, ...]] = {}
        self._drawn: dict[str, tuple[GhostGroup, ...]] = {}
        self._revision = -1
        self._added: dict[BodyId, BodyAppearance] = {}
        """How bodies are drawn that exist in the copies only."""
        self._tried: StateSnapshot | None = None
        """The state of which the shown verdict is."""
        self._replay: ReplayGhosts | None = None
        self._replay_start: float | None = None
        channel.register("plan.evaluate", EvaluatePlanRequest, self._start, SPAWN, queue="plan")
        channel.register("plan.act", ActRequest, self._act, RUN, queue="plan")
        channel.register("plan.cancel", EmptyRequest, self._stop, READ, queue="plan.cancel")
        channel.register("plan.replay", EmptyRequest, self._play, READ, queue="plan")
        channel.register("plan.clear", EmptyRequest, self._clear, READ, queue="plan")
        channel.register("plan.show_copies", ShowCopiesRequest, self._show_copies, READ, queue="plan")
        self._change_state(self._state)

    def close(self) -> None:
        """Ends a plan that is running."""
        self._cancel.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)

    def show(self, verdict: Verdict) -> tuple[Vector, ...]:
        """Shows the end poses of a verdict and its first failing sample at several moments, as for a picture.

        Returns:
            The positions of the ghosts [m].
        """
        groups = {_END_POSES: end_pose_ghosts(verdict)}
        if verdict.first_failure is not None:
            groups[_REPLAY] = trail_ghosts(verdict.replay().frames)
        added = self._added_appearances(verdict)
        with self._lock:
            self._replay, self._layers, self._added = None, groups, added
        rows = [row[:3] for layer in groups.values() for group in layer for row in group.poses.tolist()]
        return tuple((x, y, z) for x, y, z in rows)

    # -- for the drawing thread ----------------------------------------------------------------------------------------

    def update(self, snapshot: StateSnapshot, appearances: Mapping[BodyId, BodyAppearance]) -> bool:
        """Draws what has changed; returns whether a ghost is moving."""
        if snapshot.revision != self._revision:  # bodies may look different
            self._revision, drawn = snapshot.revision, {}
        else:
            drawn = self._drawn
        with self._lock:
            layers, replay, start = dict(self._layers), self._replay, self._replay_start
            if self._added:
                appearances = {**appearances, **self._added}
            if replay is not None and start is not None:
                elapsed = time.monotonic() - start
                layers[_REPLAY] = self._layers[_REPLAY] = replay.at(elapsed)
                if elapsed > replay.duration_s:
                    self._replay_start = None
        for layer in self._drawn.keys() - layers.keys():
            self._nodes.clear(layer)
        for layer, groups in layers.items():
            if drawn.get(layer) is not groups:
                self._nodes.show(layer, groups, appearances)
        self._drawn = layers
        self._clear_outdated(snapshot)
        copies = self._copies.update(self._simulation, snapshot, appearances)
        if copies is not None:
            shown = [
                {**copy, "color": hex_color(copy["color"])}  # type: ignore[arg-type]
                for copy in copies
            ]
            self._channel.publish("copies", {"shown": self._copies.is_shown, "copies": shown})
        return start is not None

    def _clear_outdated(self, now: StateSnapshot) -> None:
        """Removes a verdict, and what shows it, once the world is another one than that it is about."""
        with self._lock:
            if self._tried is None or self._state["state"] != "done" or not is_changed(self._tried, now):
                return
            self._layers, self._replay, self._tried = {}, None, None
            self._change_state({"state": "outdated"})

    # -- requests ------------------------------------------------------------------------------------------------------

    def _start(self, _: ClientSession, request: EvaluatePlanRequest) -> dict[str, object]:
        self._require_processes(request)
        plan = self._checked_plan(request.plan)
        state = {"state": "running", "name": plan.plan.name, "done": 0, "samples": request.samples}
        options = msgspec.structs.asdict(request) | {"plan": plan}
        self._run_in_thread(self._run, options, state)
        return {"steps": len(plan.plan.steps)}

    def _act(self, _: ClientSession, request: ActRequest) -> dict[str, object]:
        """Does a plan in the simulation itself; it can be undone."""
        plan = self._checked_plan(request.plan)
        self._run_in_thread(self._do, {"plan": plan}, {"state": "acting", "name": plan.plan.name})
        return {"steps": len(plan.plan.steps)}

    @staticmethod
    def _require_processes(request: EvaluatePlanRequest) -> None:
        if request.workers > (most := os.cpu_count() or 1):
            cause = f"this machine has {counted(most, 'processor')}"
            raise InvalidArgumentError(f"{request.workers} processes", cause=cause, remedy=f"at most {most}")

    def _checked_plan(self, text: str) -> PlanFile:
        plan = plan_from_text(text)
        with physical_simulation(self._simulation) as simulation:
            validate_plan(plan, simulation)
        return plan

    def _run_in_thread(self, run: Callable[..., None], options: Mapping[str, Any], state: dict[str, object]) -> None:
        """Starts what takes long, unless another plan is running."""
        with self._lock:
            if self._is_busy:
                cause = "a plan is running already, on this or another page"
                raise InvalidArgumentError("the plan", cause=cause, remedy="wait for it, or cancel it")
            self._cancel.clear()
            self._layers, self._replay = {}, None
            self._change_state(state)
            target = partial(self._report_errors, partial(run, **options))
            self._thread = threading.Thread(target=target, name="mindstage-plan-panel", daemon=True)
            self._thread.start()

    def _report_errors(self, run: Callable[[], None]) -> None:
        """Runs a plan, and publishes the error if it fails."""
        try:
            run()
        except MindstageError as error:
            self._set_state({"state": "error", "error": str(error)})
        except Exception as error:
            self._set_state(
                {"state": "error", "error": f"{type(error).__name__}: {error}; this is a defect of Mindstage"}
            )
            raise

    def _do(self, *, plan: PlanFile) -> None:
        with as_client(CLIENT):
            result = act(self._simulation, plan, stop=self._cancel.is_set)
        cause = "" if result.cause is None else f": {result.cause.text}"
        why = f"done in {result.duration_s:.1f} s{cause}"
        self._set_state({"state": "acted", "outcome": result.outcome.value, "why": why})

    def _run(self, *, plan: Any, **options: Any) -> None:
        tried = self._simulation.state
        with physical_simulation(self._simulation) as simulation:
            verdict = evaluate_plan(simulation, plan, **options, progress=self._on_progress, cancel=self._cancel.is_set)
            self._finish(verdict, tried)

    def _finish(self, verdict: Verdict, tried: StateSnapshot) -> None:
        groups, added = end_pose_ghosts(verdict), self._added_appearances(verdict)
        replay = ReplayGhosts(verdict.replay().frames) if verdict.first_failure is not None else None
        shown = max((len(group.poses) for group in groups), default=0)
        with self._lock:
            self._layers, self._replay, self._replay_start = {_END_POSES: groups}, replay, None
            self._added, self._tried = added, tried
        drawn = [group.body for group in groups]
        self._set_state(
            {
                "state": "done",
                "outcome": verdict.outcome.value,
                "why": str(verdict),
                "probability": verdict.probability,
                "interval": verdict.interval,
                "samples": verdict.samples,
                "succeeded": verdict.succeeded,
                "failed": verdict.failed,
                "unknown": verdict.unknown,
                "stopped": verdict.stopped,
                "causes": [msgspec.to_builtins(each) for each in verdict.causes],
                "assumptions": verdict.assumptions,
                "drawn": drawn,
                "shown": shown,
                "failing_sample": None if verdict.first_failure is None else verdict.first_failure.index,
                "replay_s": replay.duration_s if replay is not None else None,
            }
        )

    def _added_appearances(self, verdict: Verdict) -> dict[BodyId, BodyAppearance]:
        """How bodies are drawn that the plan adds, as members of their classes."""
        knowledge, existing = self._simulation.knowledge, set(self._simulation.state.ids)
        ends = {BodyId(id) for result in verdict.results for id in result.end_poses} - existing
        found: dict[BodyId, BodyAppearance] = {}
        for step in verdict.plan.steps if ends else ():
            for thing in step.things if isinstance(step, Place) else ():
                if thing in existing:
                    continue
                body = self._simulation.make_body(thing)
                named = [id for id in ends if id.rpartition("_")[0] == local_name(body.cls)]
                world = World(iri=body.iri, bodies=tuple(replace(body, id=id) for id in named))
                found |= compute_appearance(world, knowledge.shape_rule, knowledge.ancestors)
        return found

    def _on_progress(self, progress: Progress) -> None:
        state = {"state": "running", **msgspec.to_builtins(progress)}
        with self._lock:
            self._change_state({**self._state, **state})

    def _stop(self, _: ClientSession, __: EmptyRequest) -> None:
        self._cancel.set()

    def _play(self, _: ClientSession, __: EmptyRequest) -> float:
        """Plays the failing sample; returns how long it takes [s]."""
        with self._lock:
            if self._replay is None:
                raise InvalidArgumentError("the failing sample", cause="there is none", remedy="try a plan that fails")
            self._replay_start = time.monotonic()
            self._layers[_REPLAY] = ()
            return self._replay.duration_s

    def _clear(self, _: ClientSession, __: EmptyRequest) -> None:
        self.forget()

    def forget(self) -> None:
        """Removes the result of the last plan, and what shows it."""
        with self._lock:
            self._layers, self._replay, self._tried = {}, None, None
            if not self._is_busy:
                self._change_state({"state": "idle"})

    def _show_copies(self, _: ClientSession, request: ShowCopiesRequest) -> None:
        self._copies.is_shown = request.shown

    def _set_state(self, state: dict[str, object]) -> None:
        with self._lock:
            self._change_state(state | ({"error": without_paths(str(state["error"]))} if "error" in state else {}))

    # -- under the lock ------------------------------------------------------------------------------------------------

    @property
    def _is_busy(self) -> bool:
        """Whether a plan is running. Its thread may live on for a moment after the end has been published."""
        return self._state["state"] in {"running", "acting"}

    def _change_state(self, state: dict[str, object]) -> None:
        """Sets and publishes the state, so that pages receive states in the order in which they were set."""
        self._state = state
        self._channel.publish(_TOPIC, state)
