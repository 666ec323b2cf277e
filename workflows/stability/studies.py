"""All studies of stability, {name: study(quick) → Dataset}; one that takes a moment comes first."""

from workflows.shared.amplitudes import amplitudes
from workflows.stability import limits, searches, tori

STUDIES = {
    "disorder": searches.disordered_orbits,
    "cusp": limits.near_cusp,
    "boundary": limits.past_boundary,
    "fractions": limits.disguised_fractions,
    "twist": limits.beyond_the_twist,
    "amplitude": amplitudes,
    "beam": searches.missed_survivors,
    "fakes": searches.fake_circles,
    "tori": tori.nearly_resonant,
}
