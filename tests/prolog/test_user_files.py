"""Files of KnowRob users: what they load, what is missing and why, and their OWL predicates."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mindstage.prolog import PrologConsole
from tests.conftest import data_folder

KITCHEN = "http://mindstage.org/maps/kitchen.owl#"
KNOWROB = "http://knowrob.org/kb/knowrob.owl#"
