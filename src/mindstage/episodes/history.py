"""Recordings as the past that questions are about: see `mindstage.knowledge.history`."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import cast

import numpy as np

from mindstage.engines import make_engine
from mindstage.episodes.episode import Episode
from mindstage.episodes.recorder import Recorder
from mindstage.episodes.recording import EpisodeFrame, Recording
from mindstage.errors import InvalidArgumentError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.history import EpisodeSource, PastEvent, SingleEpisode, WorldState
from mindstage.ranges import Time, checked
from mindstage.scene import NO_GEOMETRY, Body, BodyId, GeometryMap, Iri, World
from mindstage.scene.edits import Delete
from mindstage.simulation import Simulation
from mindstage.simulation.imagined import match_world

__all__ = ["EpisodeHistory", "episode_source", "open_episode", "recorded_so_far"]

_SOURCE = "episode"
"""The source of states of a recording that does not have the name of the engine."""
_RESUMED_ENGINES = frozenset({"mujoco", "null"})
"""The engines that a resumed world is simulated by, if they recorded it; any other is replaced by MuJoCo."""
_Pair = tuple[BodyId, BodyId]


def episode_source(episode: object, name: str | None = None) -> EpisodeSource:
    """What `KnowledgeBase.add_episode` takes, as a source of episodes.

    Raises:
        InvalidArgumentError: it is no recording, or it is a source with many episodes and a name is given.
    """
    if hasattr(episode, "find_events"):
        if name is not None:
            raise InvalidArgumentError("name", cause="a source with many episodes has their names", remedy="omit it")
        return cast("EpisodeSource", episode)
    if isinstance(episode, EpisodeHistory):
        return SingleEpisode(episode if name is None else EpisodeHistory(episode.recording, name=name))
    if isinstance(episode, Recording):
        return SingleEpisode(EpisodeHistory(episode, name=name))
    remedy = "give a Recording, such as Episode('run.mcap')"
    raise InvalidArgumentError("the episode", cause=f"{type(episode).__name__} is no recording", remedy=remedy)


def open_episode(path: str | os.PathLike[str], *, name: str | None = None) -> EpisodeHistory:
    """Opens an episode file; the caller closes it.

    Raises:
        EpisodeFileError: it does not exist, is no episode, or nothing in it is readable.
    """
    return EpisodeHistory(Episode(path), name=name)


@contextmanager
def recorded_so_far(recorder: Recorder) -> Iterator[tuple[EpisodeSource, ...]]:
    """What a recorder has written, as an episode with the name of its file; empty if it does not record any more."""
    if not recorder.recording:
        yield ()
        return
    recorder.flush()
    with Episode(recorder.path) as episode:
        yield (episode_source(episode),)


class EpisodeHistory:
    """The past of the world of one recording."""

    def __init__(
        self, recording: Recording, *, name: str | None = None, knowledge: KnowledgeBase | None = None
    ) -> None:
        """Reads nothing yet.

        Args:
            name: the name of the episode; by default that of the recording.
            knowledge: what a resumed simulation uses; by default the bundled ontology only.
        """
        self.recording = recording
        self.name = name or recording.name
        self._knowledge = knowledge
        self._geometry: tuple[tuple[BodyId, ...], GeometryMap] | None = None

    @property
    def begin_s(self) -> float:
        """See `History`."""
        return self.recording.begin_s

    @property
    def end_s(self) -> float:
        """See `History`."""
        return self.recording.end_s

    @property
    def start_unix_s(self) -> float | None:
        """See `History`."""
        return self.recording.start_unix_s

    @checked
    def state_at(self, time_s: Time) -> WorldState:
        """See `History`."""
        if hasattr(self.recording, "state_at"):
            return cast("WorldState", self.recording.state_at(time_s))
        return self._state(self.recording.frame_at(time_s), None)

    @checked
    def states(self, begin_s: Time | None = None, end_s: Time | None = None) -> Iterator[tuple[float, WorldState]]:
        """See `History`."""
        begin = self.begin_s if begin_s is None else begin_s
        end = self.end_s if end_s is None else end_s
        first = self.recording.frame_at(begin)
        self.recording.frame_at(end)
        # Contacts of bodies that sleep are those of the time at which they fell asleep, which may be before `begin`.
        start = self.begin_s if first.contacts is not None else first.time_s
        contacts = _ContactMemory()
        before: EpisodeFrame | None = None
        due: EpisodeFrame | None = None
        for frame in _last_of_each_time(self.recording.frames(start, end)):
            contacts.add(frame)
            if frame.time_s <= begin:
                due = frame
                continue
            if due is not None:
                yield begin, self._state(due, contacts.before)
                before, due = due, None
            if before is None or contacts.changed or _differs(before, frame):
                yield frame.time_s, self._state(frame, contacts.pairs)
                before = frame
        if due is not None:
            yield begin, self._state(due, contacts.pairs)

    def events(self) -> Sequence[PastEvent]:
        """See `History`."""
        return self._events

    @cached_property
    def _events(self) -> tuple[PastEvent, ...]:
        names = self._entities
        return tuple(
            PastEvent(
                episode=self.name,
                id=event.id,
                kind=event.kind.value,
                begin_s=event.begin_s,
                end_s=event.end_s,
                episode_end_s=self.end_s,
                thing=names.get(event.thing, Iri(event.thing)),
                other=None if event.other is None else names.get(event.other, Iri(event.other)),
                agent=None if event.agent is None else names.get(event.agent, event.agent),
                joint=None if event.joint is None else names.get(event.joint, Iri(event.joint)),
                amount=event.amount,
                evidence=event.evidence,
            )
            for event in sorted(self.recording.events(), key=lambda event: event.begin_s)
        )

    def edits(self) -> Sequence[tuple[float, str, str, tuple[Iri, ...]]]:
        """See `History`."""
        names = self._entities
        return [
            (edit.time_s, edit.kind, edit.client, tuple(names.get(id, Iri(id)) for id in edit.ids))
            for edit in self.recording.edits()
        ]

    def individuals(self) -> Mapping[str, Iri]:
        """See `History`."""
        return {name: body.iri for body in self.bodies() for name in (body.id, body.iri)}

    def bodies(self) -> Sequence[Body]:
        """The bodies that exist at some time, each once, as they were first described."""
        return self._bodies

    @cached_property
    def _bodies(self) -> tuple[Body, ...]:
        found: dict[BodyId, Body] = {}
        for world in self._worlds:
            for body in world.bodies:
                found.setdefault(body.id, body)
        return tuple(found.values())

    @cached_property
    def _entities(self) -> Mapping[str, Iri]:
        """The IRIs of bodies and joints, by id."""
        found: dict[str, Iri] = {}
        for world in self._worlds:
            found.update((body.id, body.iri) for body in world.bodies)
            found.update((joint.id, joint.iri) for joint in world.joints)
        return found

    @cached_property
    def _worlds(self) -> tuple[World, ...]:
        """All worlds that differ in more than poses, and those that were spawned."""
        found: dict[int, World] = {}
        for frame in self.recording.frames():
            found.setdefault(id(frame.structure), frame.structure)
        return (*self.recording.spawned, *found.values())

    @checked
    def resume(self, time_s: Time) -> Simulation:
        """See `History`."""
        if hasattr(self.recording, "resume"):
            return cast("Simulation", self.recording.resume(time_s))
        state = self.state_at(time_s)
        engine = make_engine(state.source if state.source in _RESUMED_ENGINES else "mujoco")
        simulation = Simulation(self._knowledge or KnowledgeBase(), engine)
        try:
            now = {body.id for body in state.world.bodies}
            for world in state.spawned:
                simulation.spawn(world, geometry={each: state.geometry[each] for each in state.geometry if each in now})
            simulation.apply(Delete(tuple(each for each in simulation.state.ids if each not in now)))
            simulation.engine.run(
                lambda engine: match_world(engine, state.world, worlds=state.spawned), label="resume", edits=True
            )
        except BaseException:
            simulation.close()
            raise
        return simulation

    def knowledge(self) -> KnowledgeBase:
        """A new knowledge base with the statements of the one that was recorded; that of a recording without, empty.

        Raises:
            EpisodeFileError: it is damaged.
        """
        if hasattr(self.recording, "knowledge"):
            return cast("KnowledgeBase", self.recording.knowledge())
        return KnowledgeBase()

    def close(self) -> None:
        """Closes the file of the recording, if it has one; may be called repeatedly."""
        if hasattr(self.recording, "close"):
            self.recording.close()

    def _state(self, frame: EpisodeFrame, touching: Collection[_Pair] | None) -> WorldState:
        return WorldState(
            world=frame.world(),
            spawned=self._spawned(frame),
            joint_positions=frame.joint_positions,
            source=self._source,
            geometry=self._geometry_of(frame.ids),
            touching=touching,
        )

    def _geometry_of(self, ids: tuple[BodyId, ...]) -> GeometryMap:
        if self._geometry is None or self._geometry[0] is not ids:
            exists = {*ids}
            found = {id: each for id, each in self.recording.geometry.items() if id in exists}
            self._geometry = ids, found or NO_GEOMETRY
        return self._geometry[1]

    def _spawned(self, frame: EpisodeFrame) -> tuple[World, ...]:
        """The worlds that were spawned until the time of a frame."""
        if not hasattr(self.recording, "spawned_at"):
            exists = {*frame.ids}
            worlds = self.recording.spawned
            return tuple(each for each in worlds if not each.bodies or any(body.id in exists for body in each.bodies))
        known = self._spawned_with.get(id(frame.structure))
        if known is None or known[0] is not frame.structure:
            known = frame.structure, self.recording.spawned_at(frame.time_s)
            self._spawned_with[id(frame.structure)] = known
        return known[1]

    @cached_property
    def _spawned_with(self) -> dict[int, tuple[World, tuple[World, ...]]]:
        """The worlds that were spawned before a structure, which is kept so that its address is not used again."""
        return {}

    @cached_property
    def _source(self) -> str:
        if hasattr(self.recording, "state_at"):
            return cast("WorldState", self.recording.state_at(self.begin_s)).source
        return getattr(self.recording, "source", _SOURCE)


def _last_of_each_time(frames: Iterator[EpisodeFrame]) -> Iterator[EpisodeFrame]:
    before: EpisodeFrame | None = None
    for frame in frames:
        if before is not None and before.time_s != frame.time_s:
            yield before
        before = frame
    if before is not None:
        yield before


def _differs(before: EpisodeFrame, frame: EpisodeFrame) -> bool:
    return (
        before.structure is not frame.structure
        or before.ids != frame.ids
        or before.joint_positions != frame.joint_positions
        or not np.array_equal(before.poses, frame.poses)
    )


def _touching_pairs(frame: EpisodeFrame) -> frozenset[_Pair] | None:
    if frame.contacts is None:
        return None
    return frozenset((each.a, each.b) for each in frame.contacts if each.b is not None)


class _ContactMemory:
    """The bodies that touch: engines report no contacts of bodies that sleep, so those that have not moved remain."""

    def __init__(self) -> None:
        self.pairs: frozenset[_Pair] | None = None
        self.before: frozenset[_Pair] | None = None
        self.changed = False
        self._last: EpisodeFrame | None = None

    def add(self, frame: EpisodeFrame) -> None:
        """Takes the next frame."""
        now = _touching_pairs(frame)
        if now is not None and self.pairs and self._last is not None:
            ended = [(a, b) for a, b in self.pairs if (a, b) not in now and (b, a) not in now]
            if ended:
                resting = _resting_bodies(self._last, frame)
                now |= {(a, b) for a, b in ended if a in resting and b in resting}
        self.before, self.changed, self.pairs, self._last = self.pairs, now != self.pairs, now, frame


def _resting_bodies(before: EpisodeFrame, frame: EpisodeFrame) -> frozenset[BodyId]:
    """The bodies whose pose is exactly that of the frame before."""
    if before.ids == frame.ids:
        unmoved = (before.poses == frame.poses).all(axis=1)
        return frozenset(frame.ids[row] for row in np.flatnonzero(unmoved).tolist())
    rows = {id: row for row, id in enumerate(before.ids)}
    poses = zip(frame.ids, frame.poses, strict=True)
    return frozenset(id for id, pose in poses if id in rows and np.array_equal(before.poses[rows[id]], pose))
