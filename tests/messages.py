"""Requirements of tests on a message: place, value and remedy, not the sentence around them."""


def has_parts(message: str, parts: str) -> bool:
    """Whether the message has the parts, separated by `` .. ``, in this order; any words may stand between them."""
    at = 0
    for part in parts.split(" .. "):
        found = message.find(part, at)
        if found < 0:
            return False
        at = found + len(part)
    return True
