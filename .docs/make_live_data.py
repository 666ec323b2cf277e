"""Write the boundary that the live page shows: python .docs/make_live_data.py

CB_gt between 0 and 45 degrees, of which the whole plane is an image; half a minute of CPU time.
"""

import json
from pathlib import Path

import numpy as np

from pipeline.cubes.barrier import boundary

TOL = 1e-4
CUSP = 45 - np.geomspace(0.03, 3, 13)[::-1]  # more rays next to the cusp


def main() -> None:
    angles = sorted({*np.linspace(0, 45, 46), *CUSP.round(4)})
    cube = boundary(angles, TOL)
    names = {"value": "critical_scale", "lower": "lower", "upper": "upper"}
    data = {"angle": cube.angle.values.tolist(), "circle": cube.circle.values.tolist()}
    data |= {key: cube[name].values.round(9).tolist() for key, name in names.items()}
    text = json.dumps(data, ensure_ascii=False)
    path = Path(__file__).with_name("live") / "boundary.js"
    path.write_text(f"// Made by make_live_data.py.\nconst BOUNDARY = {text};\n", encoding="utf-8")


if __name__ == "__main__":
    main()
