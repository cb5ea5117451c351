"""Files in, values out, and back: documents, overrides, records, JSON.

``documents``: ``load_structure(path)``, ``load_environment(path)``, ``load_setup(article, environment)``;
``studies``: ``load_study(path, set)``; ``records``: ``load_record(path)``, ``write_record(path, record)``;
``json_output``: ``json_text(value)``, ``write_json(path, value)``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
