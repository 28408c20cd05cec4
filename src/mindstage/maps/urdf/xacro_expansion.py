"""Expansion of xacro files by the library `xacro`, without evaluation of Python and without access to files.

The library evaluates expressions by `eval`, opens files, and has no limits. While a file is expanded here, functions of
the library that do so are replaced: expressions go to `mindstage.maps.urdf.xacro_expressions`, files are read by
functions that the caller gives, and the interpreter's budget of steps also covers nodes, texts and files.

The environment is empty: `$(optenv NAME default)` is the default and `$(env NAME)` an error.
Messages and warnings of the library are dropped. Document types are refused in every file.
"""

from __future__ import annotations

import keyword
import os
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from types import ModuleType, SimpleNamespace
from typing import Any
from xml.dom import expatbuilder, minidom
from xml.parsers.expat import ExpatError

from mindstage.access.limits import XACRO_STEPS
from mindstage.errors import SourceParseError, suggestion
from mindstage.maps.urdf.xacro_expressions import (
    MATH,
    PYTHON,
    ExpressionError,
    Function,
    Interpreter,
    Namespace,
    Value,
)

__all__ = ["XacroExpander"]

_STEPS_PER_NODE = 50
"""Steps for an XML node that is copied or evaluated."""
_STEPS_PER_YAML_BYTE = 2
"""PyYAML's parser in Python is slow."""
_MESSAGE_CHARACTERS = 2_000
_GLOBAL_NAMES = "list dict map len str float int bool True False min max round sorted range"
"""Names of the namespace `python` that are also reached without it."""
_TEXT_PARTS = re.compile(
    r"""
    \$(?P<escaped>\$+[{(])          # $${ and $$( are texts that begin with one dollar less
    | \$\{(?P<expression>[^}]*)\}
    | \$\((?P<extension>[^)]*)\)
    | (?P<text>[^$]+ | \$[^{($]+ | \$$)
    """,
    re.VERBOSE,
)
_DEFAULT = r"""\$\{.*?\}|\$\(.*?\)|(?>(?:'.*?'|".*?"|[^\s'"]+)+)|"""
_MACRO_PARAMETER = re.compile(r"^\s*([^\s:=]+?)\s*:?=\s*(\^\|?)?(" + _DEFAULT + r")(?:\s+|$)(.*)")
"""The library's pattern of a parameter with a default, with an atomic group: it took exponential time."""


class XacroExpander:
    """Expands xacro files in this process, one at a time.

    All imports are made by the constructor; afterwards no file is opened but through the given functions.
    """

    def __init__(
        self,
        *,
        read_file: Callable[[str], bytes],
        list_files: Callable[[str], Sequence[str]],
        find_package: Callable[[str], str],
        steps: int = int(XACRO_STEPS.maximum),
    ) -> None:
        """Initializes an expander.

        Args:
            read_file: returns the content of the file at a path: the file itself, one that it includes, or YAML. The
                path is absolute if that of the expanded file is; it may contain "..". Raises `OSError` for a file that
                does not exist or must not be read; an optional include is then omitted.
            list_files: returns the paths that match the pattern of an include, as `glob.glob` does.
            find_package: returns the folder of a package; raises `LookupError`.
            steps: the budget of each expansion.

        Raises:
            ImportError: xacro is not installed.
        """
        import xacro
        from xacro import substitution_args

        self._library: Any = xacro
        self._substitutions: Any = substitution_args
        self._yaml: Any = substitution_args.yaml
        self._read_file, self._list_files, self._find_package = read_file, list_files, find_package
        self._working_folder = os.getcwd()
        self._steps = steps
        self._interpreter = Interpreter()
        self._known_arguments: set[str] = set()

    def expand(self, path: str, arguments: Mapping[str, str] | None = None) -> str:
        """Returns the XML of a file after expansion.

        Args:
            path: the file, as `read_file` gets it.
            arguments: values of `xacro:arg` elements, by name.

        Raises:
            SourceParseError: it cannot be read or expanded, exceeds a limit, or neither declares nor uses one of the
                arguments; its cause has one line.
        """
        library, given = self._library, dict(arguments or {})
        self._known_arguments = set()
        self._interpreter = Interpreter(
            steps=self._steps,
            namespace_types=[library.NameSpace],
            mapping_types=[library.YamlDictWrapper],
            list_types=[library.YamlListWrapper],
        )
        try:
            with self._replaced(), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                text: str = library.process_file(path, mappings=dict(given), verbosity=0).toxml()
        except RecursionError:
            cause = "its macros, elements or expressions are nested too deeply"
        except MemoryError:
            cause = "it needs too much memory"
        except Exception as error:  # the library raises anything
            cause = " ".join(str(error)[:_MESSAGE_CHARACTERS].split()) or type(error).__name__
        else:
            known = sorted(self._known_arguments)
            unknown = next((name for name in given if name not in self._known_arguments), None)
            if unknown is None:
                return text
            cause = f"it has no argument {unknown!r}; {suggestion(unknown, known, none='it declares none')}"
        raise SourceParseError(path, cause=cause)

    @contextmanager
    def _replaced(self) -> Iterator[None]:
        """Replaces functions of the libraries within a context."""
        run, library = self._interpreter, self._library
        eval_all, clone_node = library.eval_all, minidom._clone_node  # type: ignore[attr-defined]
        parse_parameter = library.parse_macro_arg

        def limited_eval_all(node: Any, macros: Any, symbols: Any) -> None:
            run.spend(_STEPS_PER_NODE)
            eval_all(node, macros, symbols)

        def limited_clone_node(node: Any, deep: Any, document: Any) -> Any:
            run.spend(_STEPS_PER_NODE + _text_length(node) // 16)
            return clone_node(node, deep, document)

        def limited_parse_parameter(text: str) -> Any:
            run.copy(len(text))
            return parse_parameter(text)

        replacements: dict[ModuleType, dict[str, object]] = {
            library: {
                "_global_symbols": self._symbols(),
                "all_includes": [],
                "eval_all": limited_eval_all,
                "eval_extension": self._extension,
                "eval_text": self._text,
                "glob": SimpleNamespace(glob=self._list_files),
                "is_valid_name": lambda name: name.isidentifier() and not keyword.iskeyword(name),
                "load_yaml": self._load_yaml,
                "parse": self._parse,
                "parse_macro_arg": limited_parse_parameter,
                "print_location": _ignore,
                "re_macro_arg": _MACRO_PARAMETER,
                "safe_eval": run.evaluate,
                "verbosity": 0,
                "warning": _ignore,
            },
            self._substitutions: {
                "_eval": self._eval_substitution,
                "_eval_env": self._environment,
                "_eval_find": self._find_package,
                "_eval_optenv": lambda name, default="": default,
                "_resolve_args": self._resolve_substitutions,
            },
            minidom: {"_clone_node": limited_clone_node},
        }
        with ExitStack() as stack:
            for module, functions in replacements.items():
                for name, replacement in functions.items():
                    stack.callback(setattr, module, name, getattr(module, name))
                    setattr(module, name, replacement)
            yield

    # -- expressions ---------------------------------------------------------------------------------------------------

    def _symbols(self) -> dict[str, object]:
        """The names that every expression may use."""
        functions = {
            "abs_filename": lambda run, name: run.new(self._library.abs_filename_spec(run.text(name))),
            "arg": lambda run, name: run.new(self._argument(run.key(name))),
            "dotify": lambda run, mapping: run.new(self._library.YamlDictWrapper(run.apply(PYTHON["dict"], mapping))),
            "fatal": self._fatal,
            "load_yaml": lambda run, name: self._load_yaml(run.text(name)),
            "tokenize": _tokenize,
            # Messages are dropped; they are empty strings in the document.
            **dict.fromkeys(("error", "message", "print_location", "warning"), lambda run, *_, **__: ""),
        }
        xacro = Namespace({name: Function(name, call) for name, call in functions.items()})
        return {
            **MATH,
            **{name: PYTHON[name] for name in _GLOBAL_NAMES.split()},
            **{name: xacro[name] for name in ("abs_filename", "dotify", "load_yaml")},
            "math": MATH,
            "python": PYTHON,
            "xacro": xacro,
        }

    def _argument(self, name: Any) -> Any:
        self._known_arguments.add(name)
        return self._library.substitution_args_context["arg"][name]

    def _fatal(self, run: Interpreter, *parts: Value) -> Value:
        raise self._library.XacroException(" ".join(map(run.text, parts)))

    def _text(self, text: str | None, symbols: Any) -> Value:
        """Returns a text with its expressions and substitutions replaced, or the value of its only expression."""
        text = text or ""
        run = self._interpreter
        run.spend(1 + len(text) // 16)
        results: list[Value] = []
        position = 0
        while position < len(text):
            match = _TEXT_PARTS.match(text, position)
            if match is None:
                raise self._library.XacroException(f"invalid expression: {text[position : position + 100]}")
            position = match.end()
            content = match[match.lastgroup or ""]
            if match.lastgroup == "expression":
                results.append(self._expression(content, symbols))
            elif match.lastgroup == "extension":
                results.append(self._library.eval_extension(f"$({run.text(self._text(content, symbols))})"))
            else:
                results.append(content)
        if len(results) == 1:
            return results[0]
        return run.join("", map(run.text, results)) if results else ""

    def _expression(self, content: str, symbols: Any) -> Value:
        run = self._interpreter
        try:
            value = run.evaluate(run.text(self._text(content, symbols)), symbols)
            run.spend(run.size(value) // 4)  # the library may print it
        except Exception as error:
            raise self._library.XacroException(exc=error, suffix=f"\nwhen evaluating expression '{content}'") from error
        return value

    # -- substitutions -------------------------------------------------------------------------------------------------

    def _extension(self, text: str) -> str:
        if text == "$(cwd)":
            return self._working_folder
        try:
            result = self._substitutions.resolve_args(text, context=self._library.substitution_args_context)
        except self._substitutions.ArgException as error:
            raise self._library.XacroException("Undefined substitution argument", exc=error) from error
        except Exception as error:
            raise self._library.XacroException(exc=error, suffix=f"\nin the substitution {text!r}") from error
        return self._interpreter.text(result)

    def _environment(self, name: str) -> str:
        raise self._substitutions.SubstitutionException(
            f"environment variable {name!r} is not set: the environment is not passed to descriptions"
        )

    def _resolve_substitutions(self, text: str, context: Any, commands: Mapping[str, Callable[..., str]]) -> str:
        """The library's function, with a limit of the length."""
        run, resolved = self._interpreter, text
        for each in self._substitutions._collect_args(text):
            name, *arguments = (part for part in each.split(" ") if part) if each.strip(" ") else ("",)
            if name not in ("arg", "dirname", "env", "find", "optenv"):
                raise self._substitutions.SubstitutionException(f"Unknown substitution command [{each}]")
            if name == "arg":
                self._known_arguments.update(arguments[:1])
            if name in commands:
                place = f"$({each})"
                value = run.text(commands[name](place, each, arguments, context))
                run.copy(len(resolved) + resolved.count(place) * len(value))
                resolved = resolved.replace(place, value)
        return resolved

    def _eval_substitution(self, expression: str, context: Any) -> str:
        """The value of `$(eval expression)`."""
        substitutions = self._substitutions
        arguments = context.setdefault("arg", {})
        self._interpreter.spend(len(arguments) + len(expression) // 16)
        self._known_arguments.update(re.findall(r"\w+", expression))  # arguments are names there
        functions: dict[str, Callable[..., Value]] = {
            "arg": lambda run, name: run.new(substitutions.convert_value(arguments[run.text(name)], "auto")),
            "dirname": lambda run: run.new(substitutions._eval_dirname(context.get("filename"))),
            "env": lambda run, name: self._environment(run.text(name)),
            "find": lambda run, name: run.new(self._find_package(run.text(name))),
            "optenv": lambda run, name, default="": default,
        }
        names = {
            **PYTHON,
            **{name: substitutions.convert_value(value, "auto") for name, value in arguments.items()},
            **MATH,
            "true": True,
            "false": False,
            **{name: Function(name, call) for name, call in functions.items()},
        }
        return self._interpreter.text(self._interpreter.evaluate(expression, names))

    # -- files ---------------------------------------------------------------------------------------------------------

    def _read(self, path: str) -> bytes:
        data = self._read_file(path)
        self._interpreter.spend(len(data) // 4)
        return data

    def _parse(self, document: Any, path: str | None = None) -> Any:
        """Returns the DOM of a file."""
        if document is not None or path is None:
            raise TypeError("only files are expanded")
        try:
            data = self._read(path)
        except OSError as error:
            self._library.filestack.pop()
            # The library recognizes the missing file of an optional include by `exc`.
            suffix = "" if path in str(error) else f"\nwhen reading {path!r}"
            raise self._library.XacroException(exc=error, suffix=suffix) from error
        try:
            text: str | bytes = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data  # in the encoding that it declares
        try:
            parsed = _DocumentBuilder().parseString(text)
        except ExpatError as error:
            raise self._library.XacroException(f"{path} is not well-formed XML: {error}") from error
        declared = parsed.getElementsByTagName("xacro:arg")
        self._known_arguments.update(node.getAttribute("name") for node in declared)
        return parsed

    def _load_yaml(self, name: str) -> Value:
        """Returns the content of a YAML file; lengths and angles may have units (`!degrees`)."""
        library, run = self._library, self._interpreter
        path = library.abs_filename_spec(name)
        data = self._read(path)
        run.spend(len(data) * _STEPS_PER_YAML_BYTE)
        library.filestack.append(path)
        try:
            value = self._yaml.load(data, Loader=self._yaml_loader())
        finally:
            library.filestack.pop()
        run.spend(run.size(value))
        return library.YamlListWrapper.wrap(value)

    def _yaml_loader(self) -> Any:
        """A loader of YAML without exponential merges of mappings (`<<`), and with units."""
        run, yaml, symbols = self._interpreter, self._yaml, self._library._global_symbols

        class Loader(yaml.SafeLoader):  # type: ignore[misc, name-defined]
            def flatten_mapping(self, node: Any) -> None:
                for key, value in list(node.value):
                    if key.tag == "tag:yaml.org,2002:merge":
                        for each in value.value if isinstance(value, yaml.SequenceNode) else [value]:
                            if isinstance(each, yaml.MappingNode):
                                self.flatten_mapping(each)
                                run.spend(len(each.value))
                super().flatten_mapping(node)

        for unit in self._library.ConstructUnits:

            def construct(loader: Any, node: Any, factor: float = unit.value.conversion_constant) -> float:
                value = run.evaluate(loader.construct_scalar(node), symbols)
                return run.apply(PYTHON["float"], value) * factor  # type: ignore[no-any-return]

            Loader.add_constructor(unit.value.tag, construct)
        return Loader


class _DocumentBuilder(expatbuilder.ExpatBuilderNS):
    """Builder of a DOM that refuses document types, whose entities could grow without a limit."""

    def start_doctype_decl_handler(self, *_: object) -> None:
        raise ExpressionError("it has a document type (DOCTYPE), which robot descriptions do not need")


def _text_length(node: Any) -> int:
    if node.nodeType == minidom.Node.ELEMENT_NODE:
        return (
            sum(len(name) + len(str(value)) for name, value in node.attributes.items()) if node.hasAttributes() else 0
        )
    return len(node.nodeValue or "")


def _tokenize(run: Interpreter, text: Value, sep: Value = ",; ", skip_empty: Value = True) -> list[str]:
    text, separators = run.text(text), run.text(sep)
    items = re.split(f"[{re.escape(separators)}]", text)
    return run.new([item for item in items if item or not skip_empty])  # type: ignore[no-any-return]


def _ignore(*_: object, **__: object) -> None:
    """Replaces functions of the library that print."""
