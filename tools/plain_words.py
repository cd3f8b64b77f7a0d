"""Plain technical English: private words, sentences of over 30 words, docstrings that begin "What" or "The same".

``make lint`` runs it over the tracked files; each finding names file, line, word and remedy.
"""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WORDS = {
    r"beside": "next to, compared with, in addition to",
    r"besides": "also, in addition",
    r"told|tells?|telling": "report, show, distinguish, ask for",
    r"apart": "separate, distinguish, except",
    r"alike": "identical, similar, both",
    r"anew": "again",
    r"fore(?:tell|told|telling|tells)": "predict, cross-validate",
    r"whatever": "regardless of, any",
    r"doubt(?:s|ed|ful|fully)?": "reject, rejection, uncertain",
    r"likewise": "also, in the same way",
    r"reckon(?:s|ed|ing)?": "compute, estimate",
    r"spoil(?:s|t|ed|ing)?": "distort, corrupt",
}
"""Private words, each with plain ones."""
PRIVATE = re.compile(r"\b(?:" + "|".join(WORDS) + r")\b", re.IGNORECASE)
OPENING = re.compile(r'"""(What|The same)\b')
LONGEST = 30
"""Words of a sentence: what a reader holds at once."""
ALLOWED: dict[tuple[str, str], str] = {
    ("benchmarks/perf/measure.py", '"beside"'): "key of result files of `mrwarp perf`",
    ("mrwarp/nn/network_file.py", '"beside"'): "key in the metadata of network files",
    ("mrwarp/diagnose/law_choice.py", "beside"): "key `law.beside` of result.json",
}
"""File and a piece of its line that stay, with the reason."""
NOT_COVERED: tuple[str, ...] = ()
"""Files and folders that are not yet plain; the check says so."""
FILES = ("*.py", "*.md", "*.toml", "*.jinja", "Makefile", ".ci/run")
"""Files that people read."""
SELF = "tools/plain_words.py"
"""The list itself."""


def remedy(word: str) -> str:
    """Plain words for a private one."""
    return next(plain for pattern, plain in WORDS.items() if re.fullmatch(pattern, word, re.IGNORECASE))


def long_sentences(text: str) -> Iterator[tuple[int, int]]:
    """Place in ``text`` and number of words of each sentence over :data:`LONGEST` words.

    A line of a list, a table cell and a heading end a sentence as a full stop does; code counts as one word.
    """
    plain = re.sub(r"`[^`\n]*`", lambda code: "c" * len(code.group()), text)
    begin = 0
    for end in re.finditer(r"[.!?:](?=[\s)*\"]|$)|\n\s*\n|\n\s*(?:[-*+]|\d+\.|#+)\s|\||\Z", plain):
        words = len(re.findall(r"[^\s]*\w[^\s]*", plain[begin : end.start()]))
        if words > LONGEST:
            yield begin + len(plain[begin : end.start()]) - len(plain[begin : end.start()].lstrip()), words
        begin = end.end()


def prose(page: str) -> str:
    """A Markdown page with its code blocks blanked, lines kept."""
    return re.sub(r"^```.*?^```", lambda code: "\n" * code.group().count("\n"), page, flags=re.DOTALL | re.MULTILINE)


def messages(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of each string of a Python file that is no docstring; a number put in counts as a word."""
    tree = ast.parse(source)
    parts = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in ast.walk(node)}
    parts |= {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield node.lineno, "".join(str(v.value) if isinstance(v, ast.Constant) else "0" for v in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts:
            yield node.lineno, node.value


def findings(name: str, text: str) -> Iterator[str]:
    """What a file breaks, as ``file:line: word: remedy``."""
    for number, line in enumerate(text.splitlines(), 1):
        if any(name == file and piece in line for file, piece in ALLOWED):
            continue
        for word in PRIVATE.findall(line):
            yield f"{name}:{number}: '{word}': say {remedy(word)}"
        if opening := OPENING.search(line) if name.endswith(".py") else None:
            yield f"{name}:{number}: docstring begins '{opening[1]}': name the thing"
    if name.endswith(".md"):
        for place, words in long_sentences(prose(text)):
            yield f"{name}:{prose(text).count(chr(10), 0, place) + 1}: sentence of {words} words: split it"
    elif name.startswith(("mrwarp/", "paper/", "benchmarks/")) and name.endswith(".py"):
        for number, message in messages(text):
            for _, words in long_sentences(message) if ";\n" not in message else ():  # not the source of a kernel
                yield f"{name}:{number}: message with a sentence of {words} words: split it"


def main() -> int:
    """Print every finding; 1 if there is one."""
    listed = subprocess.run(["git", "ls-files", *FILES], cwd=ROOT, capture_output=True, text=True, check=True)
    names = [name for name in listed.stdout.split() if name != SELF and not name.startswith(NOT_COVERED)]
    found = [line for name in names for line in findings(name, (ROOT / name).read_text(encoding="utf-8"))]
    print("\n".join([*found, f"plain words: {len(found)} findings in {len(names)} files"]))
    if NOT_COVERED:
        print("not covered yet: " + ", ".join(NOT_COVERED))
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
