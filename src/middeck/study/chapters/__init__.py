"""One folder a chapter, tied together by the record in its ``chapter.py``; `mission` lists them."""
