"""A model as a C function: C99, nothing but the standard library."""

from __future__ import annotations

from pathlib import Path

from structsel.aircraft import Aircraft
from structsel.errors import ModelError
from structsel.exporting.code_writer import Code, Dialect, Identifiers, plain
from structsel.exporting.header import describe_channel, fact_lines, one_line, reference_lines
from structsel.model import AeroModel

_WORDS = """auto break case char const continue default do double else enum extern float for goto if inline int long
register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while _Bool
_Complex _Imaginary"""
# What <math.h> may define as a macro, and the function's own names.
_TAKEN = """in out I NAN INFINITY HUGE_VAL HUGE_VALF HUGE_VALL FP_NAN FP_INFINITE FP_ZERO FP_SUBNORMAL FP_NORMAL
FP_FAST_FMA FP_FAST_FMAF FP_FAST_FMAL FP_ILOGB0 FP_ILOGBNAN MATH_ERRNO MATH_ERREXCEPT math_errhandling fpclassify
isfinite isinf isnan isnormal signbit isgreater isgreaterequal isless islessequal islessgreater isunordered
M_E M_LOG2E M_LOG10E M_LN2 M_LN10 M_PI M_PI_2 M_PI_4 M_1_PI M_2_PI M_2_SQRTPI M_SQRT2 M_SQRT1_2 linux unix"""

_DIALECT = Dialect(
    calls={
        **{name: f"{name}({{}})" for name in ("sqrt", "sin", "cos", "tan", "exp", "log", "tanh")},
        "abs": "fabs({})",
        "sign": "sign_of({})",
        "step": "step_of({})",
        "plus": "positive_part({})",
    },
    power="pow({}, {})",
    reserved=frozenset({*_WORDS.split(), *_TAKEN.split()}),
)
# None uses fmax or the like, which turn a nan into a number.
_HELPERS = {
    "plus": "static double positive_part(double x)\n{\n    return x < 0.0 ? 0.0 : x;\n}",
    "sign": "static double sign_of(double x)\n{\n    return x > 0.0 ? 1.0 : x < 0.0 ? -1.0 : x;\n}",
    "step": "static double step_of(double x)\n{\n    return x >= 0.0 ? 1.0 : 0.0;\n}",
}


def write_c(model: AeroModel, aircraft: Aircraft | None, path: Path) -> dict[Path, str]:
    """Source, and the header that declares inputs, outputs and the function.

    Raises
    ------
    ModelError
        The source would have the header's name.
    """
    header = path.with_suffix(".h")
    if path.suffix.lower() == ".h":
        raise ModelError(
            f"The C source '{path}' would overwrite its own header. Name it {path.with_suffix('.c').name}."
        )
    prefix = plain(path.stem)
    fields, results = Identifiers(_DIALECT), Identifiers(_DIALECT)
    inputs = {channel: fields.add(channel) for channel in model.channels}
    outputs = {response: results.add(response) for response in model}
    code = Code(_DIALECT, Identifiers(_DIALECT), {channel: f"in.{name}" for channel, name in inputs.items()})
    body = []
    for response, held in model.responses.items():
        lines = [f"        {line} // {_comment(note)}" for line, note in code.add_lines(held)]
        body += [f"    out.{outputs[response]} =", *lines, "        ;"]
    taken = f"struct {prefix}_inputs in" if inputs else "void"
    declared = f"struct {prefix}_outputs {prefix}_evaluate({taken})"
    facts = [f"// {_comment(line)}".rstrip() for line in fact_lines(model, aircraft)]
    where = [f"// {_comment(line)}" for line in (one_line(model.name), *reference_lines(model, aircraft)) if line]
    members = [f"    double {name}; // {_comment(describe_channel(c, model, name))}" for c, name in inputs.items()]
    made = [f"    double {name}; // {_comment(describe_channel(c, model, name))}" for c, name in outputs.items()]
    guard = f"{prefix.upper()}_H"
    head = [
        *where, "", f"#ifndef {guard}", f"#define {guard}", "",
        *([f"struct {prefix}_inputs {{", *members, "};", ""] if inputs else []),
        f"struct {prefix}_outputs {{", *made, "};", "",
        "// Nothing is clipped. Where a formula does not hold the response is nan or infinite.",
        f"{declared};", "", "#endif",
    ]  # fmt: skip
    source = [
        *facts, "", "#include <math.h>", f'#include "{header.name}"', "",
        *(f"{_HELPERS[name]}\n" for name in sorted(code.used & set(_HELPERS))),
        declared, "{", f"    struct {prefix}_outputs out;",
        *(f"    const double {name} = {text};" for name, text in code.locals.items()),
        *body, "    return out;", "}",
    ]  # fmt: skip
    return {path: "\n".join(source) + "\n", header: "\n".join(head) + "\n"}


def _comment(text: str) -> str:
    """Text for a comment to the end of the line; a backslash, or its trigraph, would carry on to the next."""
    return text.replace("\\", "/").replace("??", "? ?")
