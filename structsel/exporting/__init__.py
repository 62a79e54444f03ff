"""Models for other tools: JSBSim, Python, C, Modelica, LaTeX, CSV, and a summary as statsmodels prints it.

One small file per target; `export_model` writes any of them.
"""

from structsel.exporting.export import TARGETS, Target, export_model

__all__ = ["TARGETS", "Target", "export_model"]
