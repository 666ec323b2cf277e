"""Cubes of results, computed tile by tile on any dask cluster; interrupted runs can be resumed.

    job = pipeline.last_barrier([0, 30, 45])     one cube and how it is computed
    barrier = pipeline.fill(job, "out")          compute what is missing; return an xarray Dataset

The functions of `pipeline.jobs` return jobs; README.md explains clusters, stores and how to define
jobs of your own. Modules are imported when they are first used; `__init__.pyi` lists them.
"""

import lazy_loader

import nasm  # raises ImportError on unsupported platforms

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
