"""Imagination: plans are tried in copies of a running world, many times, with a verdict and its reason."""

from typing import TYPE_CHECKING

from mindstage.imagination.acting import TryFirstResult, act, try_first
from mindstage.imagination.confidence import confidence_sequence, samples_to_decide, wilson_interval
from mindstage.imagination.execution import PlanRunner, is_uncertain, run_plan, validate_plan
from mindstage.imagination.executors import Executor, InProcessExecutor, Job, WorkerPoolExecutor
from mindstage.imagination.plan_files import PlanBuilder, PlanFile, PlanLike, dump_plan, load_plan, plan_schema
from mindstage.imagination.plans import (
    ChangePhysics,
    Check,
    Close,
    Move,
    Open,
    Perform,
    Place,
    Plan,
    PlanStep,
    Pull,
    Push,
    Uncertainty,
    Wait,
)
from mindstage.imagination.results import EventKind, ImaginedEvent, Outcome, SampleResult
from mindstage.imagination.verdicts import (
    CauseCount,
    IntervalKind,
    Progress,
    Replay,
    ReplayFrame,
    Verdict,
    evaluate_plan,
)
from mindstage.lazy_names import lazy_names
from mindstage.scene.edits import Attach, Detach

if TYPE_CHECKING:
    from mindstage.imagination.warp_executor import WarpExecutor

__all__ = [
    "Attach",
    "CauseCount",
    "ChangePhysics",
    "Check",
    "Close",
    "Detach",
    "EventKind",
    "Executor",
    "ImaginedEvent",
    "InProcessExecutor",
    "IntervalKind",
    "Job",
    "Move",
    "Open",
    "Outcome",
    "Perform",
    "Place",
    "Plan",
    "PlanBuilder",
    "PlanFile",
    "PlanLike",
    "PlanRunner",
    "PlanStep",
    "Progress",
    "Pull",
    "Push",
    "Replay",
    "ReplayFrame",
    "SampleResult",
    "TryFirstResult",
    "Uncertainty",
    "Verdict",
    "Wait",
    "WarpExecutor",
    "WorkerPoolExecutor",
    "act",
    "confidence_sequence",
    "dump_plan",
    "evaluate_plan",
    "is_uncertain",
    "load_plan",
    "plan_schema",
    "run_plan",
    "samples_to_decide",
    "try_first",
    "validate_plan",
    "wilson_interval",
]

__getattr__, __dir__ = lazy_names(__name__, {"WarpExecutor": "mindstage.imagination.warp_executor"})
