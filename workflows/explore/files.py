"""The panels' data as files, which the browser saves; the server writes nothing."""

import base64
import io
import json

from bokeh.models import Button, CustomJS, Div, Select

_ENDINGS = {"CSV": "csv", "netCDF": "nc"}


def panel(state, work):
    """Return the buttons that save the data shown in a panel."""
    names = [*state.datasets]
    which = Select(title="Save the", options=names, value=names[-1], width=140)
    file = Div(visible=False)
    file.js_on_change("text", CustomJS(code="saveFile(cb_obj.text)"))
    lane = work.latest("file")

    def save(kind):
        shown = state.datasets[which.value]()
        if shown is not None:
            lane.submit(_file, kind, which.value, shown, state.point, done=give)

    def give(content):
        file.text, file.text = content, ""  # so that the same file can be saved again

    buttons = [Button(label=kind) for kind in _ENDINGS]
    for button in buttons:
        button.on_click(lambda kind=button.label: save(kind))
    return which, *buttons, file


def _file(kind, name, shown, point):
    """Return a panel's Dataset as JSON: the file's name, and its content in base64."""
    from pipeline.cubes.cube import plain_attributes

    file = io.BytesIO()
    if kind == "CSV":
        if "which" in shown:  # a row for each point of the orbits
            shown = shown[["x", "y", "which"]].assign(omega=shown.omega[shown.which])
        file.write(shown.to_dataframe().to_csv(float_format="%.12g").encode())
    else:  # netCDF attributes are numbers, strings or lists of numbers
        file.write(shown.assign_attrs(plain_attributes(shown.attrs)).to_netcdf(engine="scipy"))
    name = f"{name.replace(' ', '_')}_{point[0]:g}_{point[1]:g}.{_ENDINGS[kind]}"
    return json.dumps({"name": name, "content": base64.b64encode(file.getvalue()).decode()})
