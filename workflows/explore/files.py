"""Tables of what is seen: the browser saves them, the server writes nothing."""

import base64
import io
import json

from bokeh.models import Button, CustomJS, Div, Select

from pipeline.cubes.cube import plain_attributes

_ENDINGS = {"CSV": "csv", "netCDF": "nc"}


def panel(state, work):
    """Return the buttons that save what a panel shows."""
    which = Select(title="Save the", options=[*state.seen], value=[*state.seen][-1], width=140)
    file = Div(visible=False)
    file.js_on_change("text", CustomJS(code="saveFile(cb_obj.text)"))
    lane = work.latest("file")

    def save(kind):
        seen = state.seen[which.value]()
        if seen is not None:
            lane.submit(_file, kind, which.value, seen, state.point, done=give)

    def give(content):
        file.text, file.text = content, ""  # so that the same file can be saved again

    buttons = [Button(label=kind) for kind in _ENDINGS]
    for button in buttons:
        button.on_click(lambda kind=button.label: save(kind))
    return which, *buttons, file


def _file(kind, name, seen, point):
    """Return a file of a panel's Dataset as JSON: its name and its bytes in base64."""
    file = io.BytesIO()
    if kind == "CSV":
        if "which" in seen:  # a row for each point of the orbits
            seen = seen[["x", "y", "which"]].assign(omega=seen.omega[seen.which])
        file.write(seen.to_dataframe().to_csv(float_format="%.12g").encode())
    else:  # netCDF has numbers, texts and lists of numbers
        file.write(seen.assign_attrs(plain_attributes(seen.attrs)).to_netcdf(engine="scipy"))
    name = f"{name.replace(' ', '_')}_{point[0]:g}_{point[1]:g}.{_ENDINGS[kind]}"
    return json.dumps({"name": name, "content": base64.b64encode(file.getvalue()).decode()})
