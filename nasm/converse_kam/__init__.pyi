from . import sequence as sequence
from . import symmetry_line as symmetry_line
from . import transversal as transversal
