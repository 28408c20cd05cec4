"""The Python side of `evaluate_plan`: plans as Prolog terms, and verdicts as terms."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec

from mindstage.errors import InvalidArgumentError, suggestion
from mindstage.imagination.plan_files import PlanFile
from mindstage.imagination.plans import GUESSES, Check, Plan, Uncertainty
from mindstage.imagination.trials import physical_simulation, plan_from_text
from mindstage.imagination.verdicts import evaluate_plan
from mindstage.prolog.predicates import Handler
from mindstage.prolog.swipl import Atom, Compound, Value
from mindstage.robots.skill_declaration import SkillSpec, skill_specs
from mindstage.simulation import Simulation

__all__ = ["PlanPredicates", "check_from_term", "plan_from_term", "skill_from_term", "trial_options"]

_SIGNATURES: Mapping[tuple[str, int], tuple[str, ...]] = {
    ("wait", 1): ("duration_s",),
    ("open", 1): ("thing",),
    ("open", 2): ("thing", "fraction"),
    ("close", 1): ("thing",),
    ("attach", 2): ("parent", "child"),
    ("detach", 1): ("child",),
    ("place", 2): ("thing", "where"),
    ("move", 2): ("thing", "where"),
    ("pull", 2): ("thing", "target"),
    ("pull", 3): ("thing", "target", "point"),
    ("push", 2): ("thing", "force"),
    ("push", 3): ("thing", "force", "duration_s"),
    ("set_physics", 2): ("thing", "values"),
    ("perform", 1): ("skill",),
    ("perform", 2): ("robot", "skill"),
}
"""The fields of the arguments of each step."""
_VECTORS = frozenset({"target", "force", "point"})
_BUDGET_S = 20.0
_OPTIONS = (
    "samples(N), seed(N), budget(Seconds), threshold(P), workers(N), check(Question), uncertainty(Thing, List), "
    "uncertainty(guesses)"
)


class PlanPredicates:
    """The handler of `evaluate_plan`."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self.handlers: dict[str, Handler] = {"evaluate_plan": self.evaluate_plan}

    def evaluate_plan(self, plan: Value, options: Value) -> Value:
        """Tries a plan in copies of the simulation: verdict(Outcome, Probability, Samples, Why).

        Raises:
            InvalidArgumentError: a term is no step or option.
            PlanError: the plan does not fit the world; nothing was tried.
        """
        arguments = trial_options(options, "evaluate_plan")
        with physical_simulation(self._simulation) as simulation:
            verdict = evaluate_plan(simulation, plan_from_term(plan), **arguments)
        probability = Atom("unknown") if verdict.probability is None else verdict.probability
        return Compound("verdict", (Atom(verdict.outcome.value), probability, verdict.samples, Atom(str(verdict))))


def trial_options(options: Value, predicate: str) -> dict[str, Any]:
    """The arguments of a trial from option terms, with `uncertainty` as a list.

    Raises:
        InvalidArgumentError: a term is no option; the error names the predicate.
    """
    arguments: dict[str, Any] = {"budget_s": _BUDGET_S, "uncertainty": []}
    for name, values in _option_terms(options, predicate):
        match name, values:
            case "samples" | "seed" | "workers", (int(value),):
                arguments[name] = value
            case "budget" | "threshold", (int() | float() as number,):
                arguments["budget_s" if name == "budget" else name] = float(number)
            case "check", (term,):
                arguments["check"] = check_from_term(term)
            case "uncertainty", (str() as word,) if word == GUESSES:
                arguments["uncertainty"].append(GUESSES)
            case "uncertainty", (thing, fields):
                given = _single_values(fields, predicate)
                stated = _convert({"thing": _name(thing), **given}, Uncertainty, "uncertainty")
                arguments["uncertainty"].append(stated)
            case _:
                cause = f"{name}/{len(values)} is no option with such values"
                raise InvalidArgumentError(predicate, cause=cause, remedy=f"there is {_OPTIONS}")
    return arguments


def plan_from_term(term: Value) -> PlanFile | Plan:
    """A plan from a list of step terms, one step, or a text with JSON or YAML.

    Raises:
        InvalidArgumentError: a term is no step; the error names its number.
        PlanError: the text is no plan.
    """
    if isinstance(term, str):
        return plan_from_text(str(term))
    terms = [term] if isinstance(term, Compound) else term
    if not isinstance(terms, Sequence) or not terms:
        cause = f"{_text(term)} is neither a list of steps nor a text"
        raise InvalidArgumentError("the plan", cause=cause, remedy="as in [open(fridge_door), wait(2)]")
    steps = [_step_from_term(f"step {number}", each) for number, each in enumerate(terms, 1)]
    plan: Plan = _convert({"steps": steps}, Plan, "the plan")
    return plan


def check_from_term(term: Value) -> Check:
    r"""A check from a question with named arguments: `where_is(thing=mug, other=table)`; `\+ Question` expects none."""
    expect = "any"
    if isinstance(term, Compound) and term.name == "\\+" and len(term.arguments) == 1:
        expect, term = "none", term.arguments[0]
    if not isinstance(term, Compound):
        return Check(question=_name(term), expect=expect)  # type: ignore[arg-type]
    args: dict[str, Any] = {}
    for each in term.arguments:
        if not (isinstance(each, Compound) and each.name == "=" and len(each.arguments) == 2):
            remedy = "as in check(where_is(thing=mug, other=table))"
            raise InvalidArgumentError("check", cause=f"{_text(each)} is no argument with its name", remedy=remedy)
        key, value = each.arguments
        args[_name(key)] = str(value) if isinstance(value, str) else value
    check: Check = _convert({"question": term.name, "args": args, "expect": expect}, Check, "check")
    return check


def skill_from_term(term: Value) -> tuple[str, dict[str, str | float]]:
    """A skill and its arguments from a term such as `place(milk, on=table)`, `place(milk, on(table))` or `park`.

    Raises:
        InvalidArgumentError: there is no such skill, or it does not take these arguments.
    """
    if isinstance(term, Compound):
        name, arguments = term.name, term.arguments
    else:
        name, arguments = _name(term), ()
    known = skill_specs()
    spec = known.get(name)
    if spec is None:
        raise InvalidArgumentError("perform", cause=f"there is no skill {name!r}", remedy=f"{suggestion(name, known)}")
    args: dict[str, object] = {}
    for at, argument in enumerate(arguments):
        key, value = _argument(spec, at, argument)
        if key in args:
            raise InvalidArgumentError(name, cause=f"{key} is given twice", remedy="give it once")
        args[key] = str(value) if isinstance(value, str) else value
    return name, spec.check(args)


def _argument(spec: SkillSpec, at: int, term: Value) -> tuple[str, Value]:
    """The name and the value of an argument: Name=Value, Name(Value), or in the order of the parameters."""
    names = [each.name for each in spec.parameters]
    match term:
        case Compound("=", (str() as name, value)):
            return str(name), value
        case Compound(name, (value,)) if name in names or name == "in":
            return "into" if name == "in" else name, value
    if at >= len(names):
        remedy = f"it takes {', '.join(names) or 'none'}"
        raise InvalidArgumentError(spec.name, cause=f"{at + 1} arguments are too many", remedy=remedy)
    return names[at], term


def _step_from_term(place: str, term: Value) -> dict[str, Any]:
    known = ", ".join(dict.fromkeys(f"{name}/{arity}" for name, arity in _SIGNATURES))
    if not isinstance(term, Compound) or (term.name, len(term.arguments)) not in _SIGNATURES:
        raise InvalidArgumentError(place, cause=f"{_text(term)} is no step", remedy=f"there is {known}")
    if term.name == "perform":
        *robot, skill = term.arguments
        name, args = skill_from_term(skill)
        named = {"robot": _name(robot[0])} if robot else {}
        return {"do": "perform", "skill": name, "args": args, **named}
    step: dict[str, Any] = {"do": term.name}
    for field, value in zip(_SIGNATURES[term.name, len(term.arguments)], term.arguments, strict=True):
        if field == "where":
            step |= _where(place, term.name, value)
        elif field == "values":
            step |= _single_values(value, place)
        elif field in _VECTORS:
            step[field] = _numbers(place, value, 3)
        else:
            step[field] = str(value) if isinstance(value, str) else value
    return step


def _where(place: str, step: str, term: Value) -> dict[str, Any]:
    """Where a thing is placed, on(H) or in(H), or moved, by(X, Y, Z) or to(X, Y, Z, QW, QX, QY, QZ)."""
    match step, term:
        case "place", Compound("on", (holder,)):
            return {"on": _name(holder)}
        case "place", Compound("in" | "into", (holder,)):
            return {"into": _name(holder)}
        case "move", Compound("by", values):
            return {"by": _numbers(place, values, 3)}
        case "move", Compound("to", values):
            numbers = _numbers(place, values, 7)
            return {"to": {"position": numbers[:3], "quaternion": numbers[3:]}}
    remedy = "on(Holder) or in(Holder)" if step == "place" else "by(X, Y, Z) or to(X, Y, Z, QW, QX, QY, QZ)"
    raise InvalidArgumentError(place, cause=f"{_text(term)} is no place", remedy=f"give {remedy}")


def _numbers(place: str, value: Value, count: int) -> list[float]:
    parts = value.arguments if isinstance(value, Compound) else value
    if isinstance(parts, Sequence) and not isinstance(parts, str) and len(parts) == count:
        numbers = [float(each) for each in parts if isinstance(each, int | float)]
        if len(numbers) == count:
            return numbers
    raise InvalidArgumentError(place, cause=f"{_text(value)} is no list of {count} numbers")


def _option_terms(options: Value, place: str) -> Iterator[tuple[str, tuple[Value, ...]]]:
    for each in options if isinstance(options, Sequence) and not isinstance(options, str) else (options,):
        if not isinstance(each, Compound):
            raise InvalidArgumentError(place, cause=f"{_text(each)} is no option", remedy=f"there is {_OPTIONS}")
        if each.name == "=" and len(each.arguments) == 2:
            yield _name(each.arguments[0]), (each.arguments[1],)
        else:
            yield each.name, tuple(each.arguments)


def _single_values(options: Value, place: str) -> dict[str, Value]:
    """Fields with one value each, as `mass_kg(2)` or `mass_kg=2`."""
    found: dict[str, Value] = {}
    for name, values in _option_terms(options, place):
        if len(values) != 1:
            cause = f"{_text(Compound(name, values))} has {len(values)} values"
            raise InvalidArgumentError(place, cause=cause, remedy=f"give one, as in {name}(1)")
        found[name] = values[0]
    return found


def _text(term: Value) -> str:
    """A term as it is written in Prolog, without quotes."""
    match term:
        case Compound():
            return f"{term.name}({', '.join(map(_text, term.arguments))})"
        case str():
            return str(term)
        case Sequence():
            return f"[{', '.join(map(_text, term))}]"
    return str(term)


def _name(value: Value) -> str:
    if isinstance(value, str):
        return str(value)
    raise InvalidArgumentError("the plan", cause=f"{_text(value)} is not a name")


def _convert(value: object, type: Any, place: str) -> Any:
    try:
        return msgspec.convert(value, type)
    except msgspec.ValidationError as error:
        raise InvalidArgumentError(place, cause=str(error)) from error
