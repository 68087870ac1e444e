#!/bin/bash
# usage: .merge.sh "<test filters>"
cd /tmp/wt/scene
export PYO3_PYTHON=$PWD/.venv/bin/python
exec 9>/tmp/wt/merge.lock; flock 9
git merge main 2>&1 | tail -5
git diff --name-only --diff-filter=U | grep . && { echo CONFLICT; exit 1; }
git diff --check HEAD >/dev/null
cargo fmt --all --check || exit 1
cargo clippy --workspace --all-targets -- -D warnings 2>&1 | tail -15; [ ${PIPESTATUS[0]} = 0 ] || exit 1
cargo test -q --test core -- $1 2>&1 | tail -8; [ ${PIPESTATUS[0]} = 0 ] || exit 1
git -C /work/main merge --ff-only scene 2>&1 | tail -2
