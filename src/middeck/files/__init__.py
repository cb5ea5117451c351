"""Files in, values out, and back: documents, overrides, records, JSON.

``load_structure(path)``, ``load_environment(path)``, ``load_case(article, environment, overrides)``,
``load_study(path, overrides)`` in `documents` and `studies`; ``load_record(path)`` in `records`.
"""
