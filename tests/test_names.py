"""One word for one thing: no class name twice, and no private word for what has a name in the field."""

import ast
from collections import Counter

from tests.package_source import modules

# Class names that are used for two things, still. This list only shrinks.
USED_TWICE: set[str] = set()

# A word of our own, and the words of the field (docs/glossary.md).
FIELD_WORDS = {
    "told": "stated, predicted or simulated",
    "foretold": "predicted",
    "flown": "recorded or simulated",
    "craft": "aircraft",
    "crafts": "aircraft",
    "plane": "aircraft",
    "incidence": "angle of attack",
    "late": "delayed",
    "lateness": "delay",
    "mistakes": "sign and unit checks",
    "station": "the verb of the room",
    "story": "text report",
    "asides": "notes",
    "manners": "common options",
    "bench": "problem",
    "moments": "cross-products",
    "colour": "residual autocorrelation, noise model",
    "colours": "noise models",
    "doubting": "quality checks",
    "doubts": "warnings",
    "rivals": "aliases",
    "share": "fraction",
    "way": "distance, or method",
    "surroundings": "environment",
    "warmer": "ISA offset",
    "flank": "flank-angle vane",
    "stops": "position limits",
    "nats": "log Bayes factor, log-likelihood",
    "surprise": "innovation",
    "proving": "proof",
    "apart": "isolated, in a process of its own",
    "learner": "regression",
    "keeping": "with_columns",
    "beside": "with_effect",
    "taking": "with_effects",
    "sharpening": "refinement",
}
# Modules, and public parameters with their modules, that still use such a word. This list only shrinks; in plotting a
# colour is a colour.
REMAIN = {
    "structsel.numerics.kinematics: flank",
    "structsel.plotting.style: colour",
}


def defined(kind):
    """(module, node) of every definition of a kind."""
    return [(module, node) for module, tree in modules().items() for node in ast.walk(tree) if isinstance(node, kind)]


def class_names_used_twice():
    count = Counter(node.name for _, node in defined(ast.ClassDef))
    return {name for name in count if count[name] > 1}


def private_words():
    """Modules and public parameters that are named by a word of our own."""
    names = {(module, module.rpartition(".")[2]) for module in modules()}
    for module, node in defined(ast.FunctionDef):
        if not node.name.startswith("_"):
            arguments = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
            names |= {(module, one.arg) for one in arguments}
    return {f"{module}: {word}" for module, word in names if word in FIELD_WORDS}


def test_no_class_name_is_used_for_two_things():
    assert class_names_used_twice() <= USED_TWICE


def test_modules_and_parameters_have_the_words_of_the_field():
    found = private_words()
    instead = {name: FIELD_WORDS[name.rpartition(" ")[2]] for name in found - REMAIN}
    assert not instead
