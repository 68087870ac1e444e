//! Orientations and sets of them; no robot in here.
