"""Stability, margins and worst cases of loops with exact delays, continuous or sampled."""
