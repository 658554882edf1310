"""A hook of mkdocs: pages' links to files of the repository that are no pages lead to the repository."""

import re
from typing import Any


def on_page_markdown(text: str, *, page: Any, config: Any, **_: Any) -> str:
    """A page's text, in which links out of ``docs/`` are links into the repository."""
    up = "../" * (page.file.src_uri.count("/") + 1)
    return re.sub(rf"\]\({re.escape(up)}(?!\.)", f"]({config['repo_url'].rstrip('/')}/blob/main/", text)
