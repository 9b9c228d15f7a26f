"""Links to the API reference: from short names in docstrings, and from names of the package in the text of pages.

Pages stay plain Markdown, readable without Sphinx: ``pl.render`` in them becomes a link here.
"""

import re
from collections import Counter
from collections.abc import Iterator

from api_pages import file_of
from docutils import nodes
from public_names import page_of, places
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util.nodes import make_refnode

PAGE = re.compile(r"docs/([\w/]+)\.md")
LINKS = nodes.reference | addnodes.pending_xref | nodes.title


def targets() -> dict[str, str]:
    """What is written, in full or short, and the page that is meant; short names only where they mean one thing."""
    pages = page_of(places())
    found = {place.spoken: file_of(page) for place, page in pages.items()}
    owners = Counter(page.name for page in set(pages.values()))
    for page in set(pages.values()):
        if owners[page.name] == 1 or not page.space:
            found[page.name] = file_of(page)
    return found


TARGETS = targets()
CLASSES = {short: found.removesuffix("-class") for short, found in TARGETS.items() if found.endswith("-class")}


def page_and_anchor(text: str, env: BuildEnvironment) -> tuple[str, str] | None:
    """`Scene.load` is on the page of Scene; fields of values are described by their class."""
    text = text.strip().removesuffix("()").replace("plenoptic.", "pl.", 1)
    owner, _, member = text.rpartition(".")
    for name, part in ((text, ""), (owner, member)):
        if name in TARGETS and f"api/{TARGETS[name]}" in env.found_docs:
            full = TARGETS[name].removesuffix("-class")
            inner = f"{full}.{part}"
            return f"api/{TARGETS[name]}", inner if inner in env.domains.python_domain.objects else full
    return None


def resolve(
    app: Sphinx, env: BuildEnvironment, node: addnodes.pending_xref, content: nodes.Element
) -> nodes.Node | None:
    """For single backticks in docstrings, which say `Scene`, not `plenoptic.Scene`."""
    found = page_and_anchor(node.get("reftarget", ""), env)
    return found and make_refnode(app.builder, node["refdoc"], *found, content, node["reftarget"])


class LinkedNames(SphinxPostTransform):
    """Literals such as ``pl.render`` and ``pl.render(scene, camera)`` in the text."""

    default_priority = 9

    def literals(self) -> Iterator[nodes.literal]:
        for node in list(self.document.findall(nodes.literal)):
            if not isinstance(node.parent, LINKS):
                yield node

    def link_pages(self) -> None:
        """``docs/package.md``, as docstrings name pages for those who read them in an editor."""
        for node in list(self.document.findall(nodes.Text)):
            named = PAGE.search(node.astext())
            if not named or named[1] not in self.env.found_docs or isinstance(node.parent, LINKS | nodes.literal_block):
                continue
            title = self.env.titles[named[1]].astext()
            before, after = node.astext()[: named.start()], node.astext()[named.end() :]
            link = make_refnode(self.app.builder, self.env.docname, named[1], "", nodes.Text(title), title)
            node.parent.replace(node, [nodes.Text(before), link, nodes.Text(after)])

    def run(self, **kwargs: object) -> None:
        self.link_pages()
        for node in self.literals():
            text = node.astext()
            found = text.startswith("pl.") and page_and_anchor(text.split("(", 1)[0], self.env)
            if found and found[0] != self.env.docname:
                link = make_refnode(self.app.builder, self.env.docname, *found, node.deepcopy(), text)
                node.replace_self(link)


def setup(app: Sphinx) -> None:
    app.connect("missing-reference", resolve)
    app.add_post_transform(LinkedNames)
