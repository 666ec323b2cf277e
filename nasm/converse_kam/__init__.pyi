from . import aperiodic as aperiodic
from . import symmetry_line as symmetry_line
from . import transversal as transversal
