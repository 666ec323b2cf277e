"""Words for the page, in HTML."""


def escaped(text):
    """Return a text in which nothing is HTML: it may be of the visitor's."""
    return text.replace("&", "&amp;").replace("<", "&lt;")


def alert(text):
    """Return a message that screen readers speak; "" for none."""
    return f'<span role="alert" style="color: #a33">{escaped(text)}</span>' if text else ""
