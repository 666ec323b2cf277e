"""Words for the page, in HTML."""

from html import escape


def alert(text):
    """Return a message that screen readers speak; "" for none."""
    return f'<span role="alert" style="color: #a33">{escape(text)}</span>' if text else ""
