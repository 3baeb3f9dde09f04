"""A study, stage by stage: run it whole, or cell by cell in a notebook."""

# %% [markdown]
# # A study, stage by stage
#
# Treloar's rubber (1944): one material, seen in three homogeneous tests. Run the cells in a notebook
# (Jupyter, VS Code) or the whole file with Python. Every stage takes and returns a polars frame.

# %%
import os
from dataclasses import replace
from pathlib import Path

import polars as pl

import palpate

plugins = palpate.Plugins.load()
plugins.studies  # what `palpate init --study NAME` copies

# %% [markdown]
# A study is a file; here is one of those that palpate carries, with fewer sets than it asks for.

# %%
study = palpate.read_study(plugins.studies["treloar"].directory, plugins)
study = replace(study, n_sets=int(os.environ.get("PALPATE_SETS", "250")), n_workers=1)
study  # as a table: what is searched, where, and how

# %%
measured = palpate.measure(study, plugins)
measured.group_by("channel", maintain_order=True).agg(
    points=pl.len(), largest=pl.col("ordinate").max().round(3)
)

# %% [markdown]
# ## Simulate
#
# The design is a frame like any other: rows may be dropped or added. `folder=` would keep the results, so
# that nothing is computed twice.

# %%
design = palpate.sample(study)
stiff = design.filter(pl.col("specimen.c1") > 0.12)
simulated = palpate.simulate(study, stiff, measured)
simulated.group_by("status").agg(sets=pl.col("set_id").n_unique(), seconds=pl.col("seconds").max())

# %% [markdown]
# ## Score and select

# %%
scores = palpate.score(study, simulated, measured)
chosen = palpate.select(study, scores, stiff)
chosen.select("scenario", "set_id", "fopt", "specimen.c1", "specimen.c2", "specimen.c3")

# %% [markdown]
# A fit to the tensile test alone describes that test and misses the others: how much worse is it over
# all three than the joint fit?

# %%
errors = scores.join(chosen.select("scenario", "set_id"), on="set_id").pivot(
    on="channel", index="scenario", values="nmse"
)
errors

# %% [markdown]
# ## The best set's curves and the measured ones

# %%
best = chosen.filter(pl.col("scenario") == "joint")["set_id"][0]
curves = simulated.filter(pl.col("set_id") == best).join(
    measured.select("channel", "point", measured="ordinate"), on=["channel", "point"]
)
miss = curves.select((pl.col("ordinate") - pl.col("measured")).abs().max()).item()
f"the joint set {best} misses no point by more than {miss:.2f} MPa"

# %% [markdown]
# The same in one call, with a report to look at: `palpate.run_study(study, folder, plugins)`. A curve
# draws itself:

# %%
palpate.Curve(
    channel="uniaxial",
    abscissa=measured.filter(pl.col("channel") == "uniaxial")["abscissa"].to_numpy(),
    ordinate=measured.filter(pl.col("channel") == "uniaxial")["ordinate"].to_numpy(),
)

# %%
out = os.environ.get("PALPATE_OUT")
if out:
    chosen.write_csv(Path(out) / "chosen.csv")
