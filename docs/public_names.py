"""The reference of the public names, one page for each task."""

from __future__ import annotations

from collections.abc import Iterator

import structsel
from structsel import estimators, plotting

# Page: title, what it is for, public names in the order of use.
TASKS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "recordings": (
        "Recordings and aircraft",
        "Read, check, cut and write recordings, and describe the aircraft.",
        (
            "Recording",
            "StoredRecording",
            "read_recording",
            "read_recordings",
            "stream_recordings",
            "write_recording",
            "Aircraft",
            "demo_flights",
        ),
    ),
    "reconstruction": (
        "Reconstruction and coefficients",
        "Estimate sensor errors and the flight path, and compute the coefficients.",
        ("reconstruct", "reconstruct_all", "Reconstruction", "Reconstructions", "compute_coefficients", "compute_all"),
    ),
    "selection": (
        "Selection",
        "Select the terms of a model from candidates.",
        ("select", "Selection", "Selections", "Candidates", "Term", "Factor", "explore_residuals"),
    ),
    "models": (
        "Models and simulation",
        "Evaluate, trim, linearise and simulate a model or a built-in or JSBSim aircraft.",
        (
            "AeroModel",
            "ResponseModel",
            "simulate",
            "trim",
            "Trim",
            "linearise",
            "LinearModel",
            "Instruments",
            "Actuator",
            "Atmosphere",
            "Gust",
            "Turbulence",
            "published_aircraft",
            "PublishedAircraft",
            "open_jsbsim",
            "JSBSimAircraft",
        ),
    ),
    "refinement": (
        "Refinement",
        "Estimate parameters by output error, filter error and equation error.",
        (
            "refine",
            "Refinement",
            "equation_error",
            "LinearStructure",
            "Derivatives",
            "derivatives_by_condition",
            "compare_estimates",
            "EstimateComparison",
        ),
    ),
    "validation": (
        "Validation",
        "Compare predictions with recordings that were not used, and prove the match of a simulator.",
        ("validate", "Validation", "resimulate", "Resimulation", "ensemble", "Ensemble", "qualify", "Qualification"),
    ),
    "diagnosis": (
        "Comparison and diagnosis",
        "Compare a simulation with recordings, and find the effects that it lacks.",
        ("compare", "Mismatch", "diagnose", "Diagnosis"),
    ),
    "inputs": (
        "Inputs",
        "Compare and design manoeuvres. Single inputs such as doublets and multisines are in `structsel.inputs`.",
        ("compare_inputs", "InputComparison", "design_inputs", "InputDesign"),
    ),
    "frequency": (
        "Frequency domain",
        "Frequency responses, transfer functions, and parameters while a flight is recorded.",
        (
            "frequency_response",
            "FrequencyResponse",
            "fit_transfer_function",
            "TransferFunction",
            "RecursiveEstimator",
            "RecursiveEstimate",
        ),
    ),
    "exporting": (
        "Exporting, reports and errors",
        "Write models for other programs and results as HTML.",
        ("export_model", "write_report", "StructselError", "StructselWarning"),
    ),
}
MODULES = {
    "estimators": ("Estimators", "The three searches as scikit-learn estimators, for arrays X and y.", estimators),
    "plotting": (
        "Plotting",
        "All figures. Each `plot_` function takes `ax=`; each `draw_` function makes files.",
        plotting,
    ),
}


def reference_pages() -> Iterator[tuple[str, str]]:
    """Name and text of each page of the reference, and of its index."""
    known = [name for _, _, names in TASKS.values() for name in names]
    missing = set(structsel.__all__) - set(known) - set(MODULES)
    if missing or len(set(known)) != len(known):
        raise ValueError(f"docs/public_names.py needs each public name once; missing: {', '.join(sorted(missing))}")
    index = [
        "# Python reference\n",
        "Each public name on the page of its task. `help(structsel.select)` prints the same.\n",
    ]
    for page, (title, what, names) in TASKS.items():
        yield f"reference/{page}.md", f"# {title}\n\n{what}\n\n" + "\n\n".join(map(_entry, names)) + "\n"
        links = ", ".join(f"[`{name}`](reference/{page}.md#{_anchor(name)})" for name in names)
        index.append(f"## {title}\n\n{what}\n\n{links}\n")
    for page, (title, what, module) in MODULES.items():
        names = tuple(name for name in module.__all__ if not name.startswith("_"))
        text = "\n\n".join(f"::: structsel.{page}.{name}" for name in names)
        yield f"reference/{page}.md", f"# {title}\n\n{what}\n\n{text}\n"
        index.append(f"## {title}\n\n{what}\n\n[All names of `structsel.{page}`](reference/{page}.md)\n")
    yield "reference.md", "\n".join(index)


def _anchor(name: str) -> str:
    return "structsel.selection.select.select" if name == "select" else f"structsel.{name}"


def _entry(name: str) -> str:
    """Entry of one name; of `select`, whose stub has overloads without a body, where it is defined."""
    if name != "select":
        return f"::: structsel.{name}"
    return "::: structsel.selection.select.select\n    options:\n      heading: structsel.select"
