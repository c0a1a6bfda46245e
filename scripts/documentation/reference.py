"""Reference pages made from the program: fields from the JSON schemas, the command line, metrics, what is shipped."""

from __future__ import annotations

import ast
import inspect
import json
import re
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

Schema = Mapping[str, Any]


def schema_pages() -> Iterator[tuple[str, str]]:
    """Yield path and Markdown of a page per schema: scenario, suite, study and rig."""
    from trackers.rig import Rig
    from twin.scenario.load import DrawableScenarioFile
    from twin.studies.spec import Study
    from twin.suites.spec import Suite

    for kind, model in {"scenario": DrawableScenarioFile, "suite": Suite, "study": Study, "rig": Rig}.items():
        yield f"reference/{kind}.md", schema_page(kind, model.model_json_schema())


def options_page() -> str:
    """Format the options of every shipped tracker: a table per class, and what each preset of it sets otherwise."""
    from trackers.configuration import option_rows, options_markdown
    from trackers.presets import PRESETS, options_of

    lines = [
        "# Options of trackers",
        "",
        "Made from `twin list trackers --options NAME`, which has classes of your own too. An unknown option is refused.",
        "",
        "`--set trackers.NAME.OPTION=VALUE` changes one, as do `trackers:` of a scenario and `set:` of a suite.",
    ]
    first: dict[Any, str] = {}
    for name in PRESETS:
        model, given = options_of(name)
        if model not in first:
            first[model] = name
            lines += ["", f"## {name}", "", _text(PRESETS[name].summary), "", options_markdown(model, given).rstrip()]
            continue
        usual = {row.path: row.default for row in option_rows(model, options_of(first[model])[1])}
        own = [row for row in option_rows(model, given) if usual.get(row.path) != row.default]
        lines += ["", f"### {name}", "", f"As [{first[model]}](#{first[model]}), but for these.", ""]
        lines += ["| option | value |", "|---|---|", *(f"| `{row.path}` | `{row.default}` |" for row in own)]
    return "\n".join(lines) + "\n"


def schema_page(kind: str, schema: Schema) -> str:
    """Format a schema: a table of the fields of the file, then one per kind of object in it."""
    lines = [
        f"# Fields of a {kind}",
        "",
        f"Made from `twin schema {kind}`, which gives editors completion too. An unknown field is refused.",
        "",
    ]
    lines += _fields(schema)
    for name, part in sorted(schema.get("$defs", {}).items()):
        lines += ["", f"## {name}", ""]
        if "description" in part:
            lines += [_text(part["description"]), ""]
        lines += _fields(part)
    return "\n".join(lines) + "\n"


def _fields(schema: Schema) -> list[str]:
    if "properties" not in schema:
        return [_type(schema)]
    required = schema.get("required", ())
    lines = ["| field | type | default | meaning |", "|---|---|---|---|"]
    for name, field in schema["properties"].items():
        default = "required" if name in required else _default(field)
        lines.append(f"| `{name}` | {_type(field)} | {default} | {_text(field.get('description', ''))} |")
    return lines


def _default(field: Schema) -> str:
    if "default" not in field:
        return ""
    text = json.dumps(field["default"], ensure_ascii=False)
    return f"`{text}`" if len(text) <= 60 else "see the schema"


def _text(text: str) -> str:
    return re.sub(r"\s+", " ", text).replace("|", "\\|").replace("<", "&lt;").replace("[", "\\[")


def _type(field: Schema) -> str:
    if "$ref" in field:
        name = field["$ref"].rsplit("/", 1)[-1]
        return f"[{name}](#{name.lower()})"
    for key in ("anyOf", "oneOf"):
        if key in field:
            return " or ".join(dict.fromkeys(_type(each) for each in field[key]))
    if "allOf" in field:
        return _type(field["allOf"][0])
    if "const" in field:
        return f"`{field['const']}`"
    if "enum" in field:
        return ", ".join(f"`{each}`" for each in field["enum"])
    kind = field.get("type", "any value")
    if kind == "array":
        if "prefixItems" in field:
            return "[" + ", ".join(_type(each) for each in field["prefixItems"]) + "]"
        items = field.get("items") or {}
        return f"list of {_type(items)}" if items else "list"
    values = [*field.get("patternProperties", {}).values(), field.get("additionalProperties")]
    if kind == "object" and isinstance(values[0], Mapping):
        return f"mapping of names to {_type(values[0])}"
    return {"object": "mapping", "null": "none", "string": "text"}.get(str(kind), str(kind)) + _bounds(field)


def _bounds(field: Schema) -> str:
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}  # fmt: skip
    found = [f"{sign} {field[key]:g}" for key, sign in signs.items() if key in field and abs(field[key]) < 1e6]
    return f" {', '.join(found)}" if found else ""


def command_page() -> str:
    """Format every command of `twin` with its arguments and options."""
    import typer.main

    from twin.cli import app

    lines = ["# The command line", "", "Made from the program itself: `twin COMMAND --help` prints the same.", ""]
    lines += _commands(typer.main.get_command(app), "twin")
    return "\n".join(lines) + "\n"


def _commands(command: Any, name: str) -> Iterator[str]:
    for each, inner in sorted(getattr(command, "commands", {}).items()):
        if getattr(inner, "commands", None):
            yield from _commands(inner, f"{name} {each}")
            continue
        context = inner.make_context(each, [], resilient_parsing=True)
        yield from (f"## {name} {each}", "", re.sub(r"\s+", " ", inner.help or ""), "")
        if inner.params:
            yield from ("| argument or option | |", "|---|---|")
        for parameter in inner.params:
            written, said, *_ = parameter.get_help_record(context) or ("", "")
            yield f"| `{written}` | {_text(said)} |"
        if inner.epilog:
            yield from ("", *(f"    {line}" for line in inner.epilog.removeprefix("Example: ").split("; ")))
        yield ""


def metrics_table() -> str:
    """Format every metric with its definition."""
    from twin.report.metrics_table import METRICS

    lines = ["| key in `metrics.json` | name | unit | better | definition |", "|---|---|---|---|---|"]
    lines += [
        f"| `{key}` | {metric.name} | {metric.unit} | {metric.better} | {_text(metric.meaning)} |"
        for key, metric in METRICS.items()
    ]
    return "\n".join(lines)


def listed(kind: str) -> str:
    """Format what is shipped of a kind ('trackers', 'sensors', 'faults', 'scenarios', 'suites', 'studies') as a table."""
    from trackers.presets import available
    from twin import models

    if kind == "trackers":
        entries = {name: preset.summary for name, preset in available().items()}
    elif kind in ("sensors", "faults"):
        entries = models.SENSOR_KINDS if kind == "sensors" else models.FAULTS
    else:
        entries = {name: models.first_description(kind, name) for name in models.names(kind)}
    return "\n".join(["| name | |", "|---|---|", *(f"| `{name}` | {_text(text)} |" for name, text in entries.items())])


def sensor_fields(name: str) -> str:
    """Format fields of a sensor: those that a scanner and a camera share ('shared'), or a description's own."""
    from twin.scenario.load import DrawableScenarioFile

    parts = DrawableScenarioFile.model_json_schema()["$defs"]
    scanner, camera = (parts[each]["properties"] for each in ("LaserDescription", "PinholeDescription"))
    shared = [each for each in scanner if each in camera and each not in ("kind", "noise")]
    part = parts["LaserDescription" if name == "shared" else name]
    own = [each for each in part["properties"] if (each in shared) == (name == "shared") and each != "kind"]
    lines = ["| field | default | meaning |", "|---|---|---|"]
    for each in own:
        field, required = part["properties"][each], each in part.get("required", ())
        default = "required" if required else _default(field)
        lines.append(f"| `{each}` | {default} | {_text(field.get('description', ''))} |")
    return "\n".join(lines)


def packages(name: str) -> str:
    """Format the packages within `twin` or `trackers`, by what each says of itself."""
    root = Path(__file__).parents[2]
    lines = ["| package | holds |", "|---|---|"]
    for file in sorted((root / name).glob("*/__init__.py")):
        says = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
        lines.append(f"| `{name}/{file.parent.name}/` | {_text(' '.join(says.partition(chr(10) * 2)[0].split()))} |")
    return "\n".join(lines)


_ENTRY = re.compile(r"^::: ((?:twin|trackers)\S*)\.(\w+)$", re.MULTILINE)


def entries(text: str) -> dict[str, Any]:
    """Return the objects that a page of the Python reference has entries of, by their names in it."""
    return {f"{module}.{name}": getattr(import_module(module), name) for module, name in _ENTRY.findall(text)}


def field_rows(kind: Any) -> list[tuple[str, str, str]]:
    """Return name, type and meaning of each field of a class of data; none of any other object.

    The meaning is the description of a model's field, and of a data class the text or the comment beside it.
    """
    described = {name: field.description or "" for name, field in getattr(kind, "model_fields", {}).items()}
    names = list(described) or [field.name for field in (fields(kind) if is_dataclass(kind) else ())]
    types, said = {}, {}
    for base in reversed(getattr(kind, "__mro__", ())) if names else ():
        if base.__module__.partition(".")[0] in ("twin", "trackers"):
            text = inspect.getsource(base)
            body = ast.parse(textwrap.dedent(text)).body[0]
            assert isinstance(body, ast.ClassDef)
            for each, after in pairwise([*body.body, ast.Pass()]):
                if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name):
                    types[each.target.id] = ast.unparse(each.annotation)
                    line = text.splitlines()[(each.end_lineno or 0) - 1]
                    is_said = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
                    said[each.target.id] = ast.unparse(after.value)[1:-1] if is_said else line.partition("  # ")[2]
    return [(name, types[name], described.get(name) or said[name]) for name in names]


def _entry_with_fields(found: re.Match[str]) -> str:
    rows = field_rows(getattr(import_module(found[1]), found[2]))
    if not rows:
        return found[0]
    head = [found[0], "", f"Fields of `{found[2]}`:", "", "| field | type | meaning |", "|---|---|---|"]
    return "\n".join([*head, *(f"| `{name}` | `{_code(kind)}` | {_text(said)} |" for name, kind, said in rows)])


def _code(text: str) -> str:
    return text.replace("|", "\\|")


_TABLES = {"list": listed, "packages": packages, "fields": sensor_fields, "metrics": lambda _: metrics_table()}
_LISTED = re.compile(r"\{\{ (" + "|".join(_TABLES) + r")\b ?(\w*) \}\}")


def is_filled(text: str) -> bool:
    """Return whether a page has parts that `fill` replaces, or extends."""
    return bool(_ENTRY.search(text) or _LISTED.search(text))


def fill(text: str) -> str:
    """Replace `{{ list KIND }}`, `{{ fields NAME }}`, `{{ packages NAME }}`, `{{ metrics }}`; list the fields of classes."""
    return _ENTRY.sub(_entry_with_fields, _LISTED.sub(lambda found: _TABLES[found[1]](found[2]), text))
