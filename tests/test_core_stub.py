"""csm/_core.pyi says what the extension has: names, parameters in order, defaults, bases."""

import ast
import inspect
from pathlib import Path

import pytest

import csm
from csm import _core

STUB = ast.parse((Path(csm.__file__).parent / "_core.pyi").read_text(encoding="utf-8"))
# Names with an underscore are the stub's own, for types.
CLASSES = {
    node.name: node
    for node in STUB.body
    if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
}
FUNCTIONS = {node.name: node for node in STUB.body if isinstance(node, ast.FunctionDef)}
CONSTANTS = {
    node.target.id
    for node in STUB.body
    if isinstance(node, ast.AnnAssign) and not node.target.id.startswith("_")
}
METHODS = {
    node.name: node for node in CLASSES["Renderer"].body if isinstance(node, ast.FunctionDef)
}


def public(thing):
    return {name for name in vars(thing) if not name.startswith("_")}


def parameters(function):
    """(name, default as text or None) of a stub's parameters, without self and cls."""
    arguments = function.args
    names = [argument.arg for argument in (*arguments.posonlyargs, *arguments.args)]
    defaults = [ast.unparse(default) for default in arguments.defaults]
    pairs = zip(names, [None] * (len(names) - len(defaults)) + defaults, strict=True)
    return [pair for pair in pairs if pair[0] not in ("self", "cls")]


def documented(function):
    """The same of a C function, from the signature that its docstring begins with."""
    signature = inspect.signature(function)
    return [
        (name, None if parameter.default is parameter.empty else repr(parameter.default))
        for name, parameter in signature.parameters.items()
        if name != "self"
    ]


def test_names_are_those_of_the_extension():
    assert public(_core) == set(CLASSES) | set(FUNCTIONS) | CONSTANTS


def test_methods_are_those_of_the_extension():
    assert public(_core.Renderer) == set(METHODS) - {"__new__"}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_parameters_are_those_of_the_extension(name):
    assert parameters(FUNCTIONS[name]) == documented(getattr(_core, name))


@pytest.mark.parametrize("name", sorted(set(METHODS) - {"__new__"}))
def test_parameters_of_methods_are_those_of_the_extension(name):
    assert parameters(METHODS[name]) == documented(getattr(_core.Renderer, name))


@pytest.mark.parametrize("name", sorted(set(CLASSES) - {"Renderer"}))
def test_exceptions_have_the_same_bases(name):
    bases = [base.__name__ for base in getattr(_core, name).__bases__]
    assert [ast.unparse(base) for base in CLASSES[name].bases] == bases


def members_of(name):
    """Keys of a typed dictionary, properties of a protocol."""
    (typed,) = [node for node in STUB.body if isinstance(node, ast.ClassDef) and node.name == name]
    return {
        node.name if isinstance(node, ast.FunctionDef) else node.target.id
        for node in typed.body
        if isinstance(node, (ast.FunctionDef, ast.AnnAssign))
    }


def test_dictionaries_have_the_keys_they_come_with(fresh_renderer):
    settings = csm.ShadowSettings()
    camera = csm.Camera.look_at((0, 1, 5), (0, 0, 0))
    fitted = _core.fit_cascades(camera, (0, 1, 0), settings)
    assert members_of("_Effect") == set(_core.effect_table()[0])
    assert members_of("_Cascades") == set(fitted)
    assert members_of("_RendererInfo") == set(fresh_renderer()._core.describe())


def test_a_camera_is_what_the_core_reads():
    camera = csm.Camera.look_at((0, 1, 5), (0, 0, 0))
    wanted = members_of("_Camera")
    read = {name: getattr(camera, name) for name in wanted}
    only = type("Only", (), read)()
    assert _core.fit_diameter(only, 1.0, 2.0) == _core.fit_diameter(camera, 1.0, 2.0)
    for name in wanted:
        without = type("Less", (), {key: read[key] for key in wanted - {name}})()
        with pytest.raises(AttributeError, match=name):
            _core.fit_diameter(without, 1.0, 2.0)
