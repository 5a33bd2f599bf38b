"""Plain data handed over by a Python program, copied within the same bounds as a file's."""

from collections.abc import Mapping
from numbers import Integral, Real

from bussim.errors import Problem, ScenarioError
from bussim.scenario.yaml.parser import MAX_DEPTH, MAX_VALUES
from bussim.scenario.yaml.source_map import Path, SourceMap
from bussim.words.language import say
from bussim.words.values import show


def copied(data: object, file: str) -> object:
    """A deep copy made of dicts, lists, text, numbers, true, false and None.

    Numbers of other libraries (numpy's, fractions) become Python's. Anything else is left as it is
    for the schema to complain about. Raises ScenarioError for data that are too large, too deep
    (or contain themselves), or have keys that are not text.
    """
    source_map = SourceMap(file, data=data)
    count = 0

    def fail(path: Path, predicate: str) -> ScenarioError:
        problem = source_map.problem(path, predicate) if path else Problem(file, 0, 0, predicate)
        return ScenarioError([problem])

    def copy(item: object, path: Path) -> object:
        nonlocal count
        count += 1
        if count > MAX_VALUES:
            raise fail((), say("yaml_many", max_values=MAX_VALUES))
        if isinstance(item, Mapping | list | tuple):
            if len(path) >= MAX_DEPTH:
                raise fail(path[:1], say("yaml_deep", max_depth=MAX_DEPTH))
            if not isinstance(item, Mapping):
                return [copy(child, (*path, i)) for i, child in enumerate(item)]
            result: dict[str, object] = {}
            for key, child in item.items():
                if not isinstance(key, str):
                    raise fail(path, say("yaml_key_is", key=show(key)))
                count += 1
                result[str.__str__(key)] = copy(child, (*path, key))
            return result
        return _scalar(item)

    return copy(data, ())


def _scalar(item: object) -> object:
    if isinstance(item, str):
        return str.__str__(item)
    if isinstance(item, bool):
        return item
    if isinstance(item, Integral):
        return int(item)
    if isinstance(item, Real):
        try:
            return float(item)
        except OverflowError:
            return float("inf")
    return item
