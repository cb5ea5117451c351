"""How an article hangs, in numbers and in lines."""

from __future__ import annotations

from typing import Any

import numpy as np

from middeck.structure.suspension.attitude import Attitude


def attitude_numbers(attitude: Attitude) -> dict[str, Any]:
    """As keys of a JSON document."""
    node_tilt = np.degrees(attitude.node_tilt) + 0.0
    return {
        "tilt_deg": np.degrees(attitude.tilt) + 0.0,
        "heading_deg": float(np.degrees(attitude.heading)) + 0.0,
        "node_tilt_deg": dict(zip(attitude.node, node_tilt, strict=True)),
        "hangs_from": attitude.hangs_from,
        "lies_off_m": attitude.lies_off + 0.0,
    }


def attitude_lines(numbers: dict[str, Any], label: str = "hangs") -> list[str]:
    """The tilt of the whole, that of the worst node, and what it hangs from."""
    tilt = numbers["tilt_deg"]
    worst, most = max(
        ((name, float(np.linalg.norm(v))) for name, v in numbers["node_tilt_deg"].items()),
        key=lambda item: item[1],
    )
    off = "  ".join(f"{x:z.4f}" for x in numbers["lies_off_m"])
    return [
        f"{label:<12} tilted {np.linalg.norm(tilt):z.3f} deg: "
        f"{'  '.join(f'{x:z.3f}' for x in tilt)} about x y z; nodes up to {most:z.3f} ({worst})",
        f"             from a {numbers['hangs_from']}; its centre of mass lies {off} m off it",
    ]
