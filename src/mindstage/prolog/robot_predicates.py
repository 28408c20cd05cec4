"""The Python side of `perform` and `add_robot`: skills as Prolog terms, and their results as terms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mindstage.access.limits import PROLOG_SKILL_TIME
from mindstage.errors import InvalidArgumentError
from mindstage.imagination.acting import act, try_first
from mindstage.imagination.plans import Perform, Plan
from mindstage.imagination.results import SampleResult
from mindstage.prolog.plan_predicates import skill_from_term, trial_options
from mindstage.prolog.predicates import Handler
from mindstage.prolog.swipl import Atom, Compound, Value
from mindstage.robots.skills.designators import read_designator
from mindstage.robots.standing import add_standing_robot
from mindstage.simulation import Simulation

__all__ = ["RobotPredicates"]

_ARTICLES = frozenset({"an", "a", "the"})


class RobotPredicates:
    """The handlers of `add_robot`, `robot` and `perform`."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self.handlers: dict[str, Handler] = {
            "add_robot": self.add_robot,
            "robots": self.robots,
            "perform": self.perform,
        }

    def add_robot(self, model: Value, at: Value) -> Value:
        """Adds a robot; returns its name.

        Raises:
            InvalidArgumentError: the place is no place.
            RobotNotFoundError: there is no such model.
        """
        place = None
        if at != "free":
            numbers = at.arguments if isinstance(at, Compound) and at.name == "at" else ()
            given = [float(each) for each in numbers if isinstance(each, int | float) and not isinstance(each, bool)]
            if len(given) not in {2, 3} or len(given) != len(numbers):
                raise InvalidArgumentError("add_robot", cause="it is no place", remedy="give at(X, Y) or at(X, Y, Yaw)")
            place = (given[0], given[1], given[2] if len(given) == 3 else 0.0)
        return Atom(add_standing_robot(self._simulation, _text(model, "the model"), place).name)

    def robots(self) -> Value:
        """The names of the robots."""
        return [Atom(name) for name in self._simulation.robots]

    def perform(self, action: Value, options: Value) -> Value:
        """Lets a robot do something: result(Outcome, Why, Seconds).

        Raises:
            InvalidArgumentError: the action is no skill or designator, or its arguments or options are not valid.
            PlanError: there is no such robot or thing; nothing was done.
        """
        settings: dict[str, Any] = {"robot": "", "deadline": PROLOG_SKILL_TIME.maximum}
        at_least: float | None = None
        others: list[Value] = []
        for each in options if isinstance(options, Sequence) and not isinstance(options, str) else (options,):
            match each:
                case Compound("robot", (str() as name,)):
                    settings["robot"] = str(name)
                case Compound("deadline", (int() | float() as seconds,)):
                    settings["deadline"] = float(seconds)
                case Compound("try_first", (int() | float() as probability,)):
                    at_least = float(probability)
                case _:
                    others.append(each)
        plan = Plan(steps=tuple(self._steps(action, **settings)))
        if at_least is None:
            if others:
                trial_options(others, "perform")  # refuses what is no option
                raise InvalidArgumentError("perform", cause="nothing is tried", remedy="add try_first(P)")
            return _result_term(act(self._simulation, plan))
        arguments = trial_options(others, "perform")
        uncertainty = arguments.pop("uncertainty")
        tried = try_first(self._simulation, plan, at_least=at_least, uncertainty=uncertainty, **arguments)
        if tried.result is None:
            return Compound("result", (Atom("not_done"), Atom(tried.reason), 0.0))
        return _result_term(tried.result)

    def _steps(self, action: Value, *, robot: str, deadline: float) -> list[Perform]:
        """The steps of one action, or of a list of them."""
        if isinstance(action, str) and action.lstrip().startswith(("{", "[")):
            return [self._designated(str(action), robot, deadline)]
        if isinstance(action, Sequence) and not isinstance(action, str):
            if action and isinstance(action[0], str) and action[0] in _ARTICLES:
                return [self._designated(_plain(action), robot, deadline)]
            return [step for each in action for step in self._steps(each, robot=robot, deadline=deadline)]
        name, args = skill_from_term(action)
        return [Perform(skill=name, args=args, robot=robot, deadline_s=deadline)]

    def _designated(self, designator: Any, robot: str, deadline_s: float) -> Perform:
        found = read_designator(designator, self._simulation)
        return Perform(skill=found.skill, args=found.args, robot=robot, deadline_s=deadline_s)


def _result_term(result: SampleResult) -> Compound:
    why = result.cause.text if result.cause is not None else ""
    assumed = [f"assumed: {text}" for done in result.skills for text in done.assumptions]
    text = "; ".join(each for each in (why, *assumed) if each)
    return Compound("result", (Atom(result.outcome.value), Atom(text), result.duration_s))


def _plain(term: Value) -> Any:
    """A list term as lists of texts and numbers; `type: milk`, `type=milk` and `type-milk` are pairs."""
    if isinstance(term, Compound) and len(term.arguments) == 2 and term.name in {":", "=", "-"}:
        return [_plain(each) for each in term.arguments]
    if isinstance(term, Compound):
        return [term.name, *map(_plain, term.arguments)]
    if isinstance(term, str):
        return str(term)
    return [_plain(each) for each in term] if isinstance(term, Sequence) else term


def _text(value: Value, what: str) -> str:
    if isinstance(value, str):
        return str(value)
    raise InvalidArgumentError("perform", cause=f"{what} is no name", remedy="as in perform(put_away(milk), Result)")
