"""Models with every kind of term, states to evaluate them at, and exports called back."""

import ctypes
import importlib.util
import subprocess

import numpy as np

from structsel import AeroModel, ResponseModel, export_model

KINDS = (
    "1", "alpha", "alpha^2", "alpha*de", "alpha^3*beta^2*de",  # powers and products
    "(alpha - 0.05)", "(alpha - 0.05)^3", "(alpha + 0.1)*q_hat",  # offsets
    "(alpha - 0.1)+", "(alpha - 0.1)+^2*q_hat", "(V - 60)+*(beta)+^3",  # splines
    "step(alpha - 0.1)", "step(-beta)*de", "sign(beta)*beta^2", "abs(de)*de",  # pieces
    "sqrt(V)", "V^0.5", "(V/50)^-1.5", "1/V", "de/V^2",  # roots and denominators
    "sin(3*alpha)", "cos(beta)*p_hat", "tan(alpha)", "exp(-5*alpha)", "log(V)", "tanh(10*(alpha - 0.2))",
    "tanh(1000*beta)", "(alpha + 2*beta - de - 0.1)^2", "(0.3 - alpha)+*r_hat", "(-alpha*beta/V - 1e-05)",
    "exp(-(alpha - 0.1)^2/(2*0.05^2))", "sin(cos(alpha)*tanh(beta)/sqrt(V))", "(2 - (alpha - (beta - de)))*da",
)  # fmt: skip
"""Terms of every kind that a model can hold."""
RANGES = {
    "V": (30.0, 90.0), "alpha": (-0.2, 0.4), "beta": (-0.3, 0.3), "p_hat": (-0.1, 0.1), "q_hat": (-0.02, 0.02),
    "r_hat": (-0.1, 0.1), "de": (-0.4, 0.4), "da": (-0.4, 0.4), "dr": (-0.4, 0.4),
}  # fmt: skip


def model_of(terms_by_response, seed=0, **more):
    """A model of given terms, its values random and far apart in size."""
    rng = np.random.default_rng(seed)
    made = {}
    for name, terms in terms_by_response.items():
        values = rng.normal(size=len(terms)) * 10.0 ** rng.integers(-2, 3, len(terms))
        made[name] = ResponseModel(tuple(terms), values, **more)
    return AeroModel(made, "every kind")


def random_states(n, seed=0):
    """Channels (n,) all over their ranges."""
    rng = np.random.default_rng(seed)
    return {name: rng.uniform(low, high, n) for name, (low, high) in RANGES.items()}


def exported_to_python(model, folder):
    """The exported function, called on one state by name."""
    path = export_model(model, folder / "exported.py", to="python", overwrite=True)
    spec = importlib.util.spec_from_file_location("exported", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.evaluate


def exported_to_c(model, folder, compiler):
    """The exported function, compiled without a warning, called on one state by name."""
    source = export_model(model, folder / "exported.c", to="c", overwrite=True)
    strict = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror")
    library = folder / "exported.so"
    subprocess.run([compiler, *strict, "-shared", "-fPIC", "-o", library, source, "-lm"], check=True)

    class Inputs(ctypes.Structure):
        _fields_ = [(name, ctypes.c_double) for name in model.channels]

    class Outputs(ctypes.Structure):
        _fields_ = [(name, ctypes.c_double) for name in model]

    function = ctypes.CDLL(str(library)).exported_evaluate
    function.argtypes, function.restype = [Inputs] if model.channels else [], Outputs

    def evaluate(**channels):
        given = [Inputs(**channels)] if channels else []
        out = function(*given)
        return {name: getattr(out, name) for name in model}

    return evaluate
