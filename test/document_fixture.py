"""Readers of the documents for tests: README.md, CONTRIBUTING.md and doc/*.md."""

import glob
import os
import re

REPOSITORY = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
DOCUMENTS = ["README.md", "CONTRIBUTING.md"] + sorted(
    os.path.relpath(path, REPOSITORY) for path in glob.glob(os.path.join(REPOSITORY, "doc", "*.md")))

FENCED = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def read_document(name):
    with open(os.path.join(REPOSITORY, name), encoding="utf-8") as file:
        return file.read()


def blocks(name, language):
    """The fenced blocks of a language in a document."""
    return [body for kind, body in FENCED.findall(read_document(name)) if kind == language]


def commands(name):
    """The commands in a document's bash blocks, one a line, without comments."""
    lines = "".join(blocks(name, "bash")).replace("\\\n", " ").splitlines()
    return [line for line in (re.sub(r"(^|\s)#.*", "", line).strip() for line in lines) if line]


def prose(name):
    """A document without its fenced blocks."""
    return FENCED.sub("", read_document(name))


def code_spans(name):
    return re.findall(r"`([^`\n]+)`", prose(name))


def links(name):
    """Targets of the links and images of a document."""
    return re.findall(r"\]\(([^)\s]+)\)", prose(name))


def anchors(name):
    """Anchors of the headings of a document, as GitHub makes them."""
    titles = re.findall(r"^#+ (.*)$", prose(name), re.MULTILINE)
    return [re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles]
