"""The code that the numbers of a cube depend on: digests of sources, and versions of libraries.

A job depends on the modules of `nasm` and `pipeline.cubes` that the module of its function imports,
directly or indirectly. A new module, or an edit to a module that the job does not import, leaves
the digest of the job unchanged. The driver lists the modules; drivers and workers compute the
digest of these modules from their own files, as they were when this package was imported. A user's
own function is identified by its text and by what it refers to.
"""

from pipeline.provenance.job_code import EVERYTHING, Code, code_of
from pipeline.provenance.own_code import ByValue
from pipeline.provenance.sources import PROGRAM
