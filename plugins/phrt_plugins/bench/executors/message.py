"""What goes to a worker and comes back: bytes, so that whatever cannot be sent is that task's own error."""

from __future__ import annotations

import pickle
import traceback
from collections.abc import Callable
from typing import Any

from phrt.registry.manager import describe
from phrt_plugins.bench.executors.base import TaskError


def packed(function: Callable[[Any], Any], task: Any) -> bytes | TaskError:
    """A call, to be sent."""
    try:
        return pickle.dumps((function, task))
    except Exception as error:
        return TaskError("refused", f"the task cannot be sent to a worker: {describe(error)}")


def answer(sent: bytes) -> bytes:
    """In the worker: do what was `packed`, and pack what came of it. Raises nothing."""
    try:
        function, task = pickle.loads(sent)
    except Exception as error:
        return pickle.dumps(TaskError("refused", f"the worker cannot read its task: {describe(error)}", _details()))
    try:
        result = function(task)
    except (Exception, SystemExit) as error:
        return pickle.dumps(TaskError("raised", describe(error), _details()))
    try:
        return pickle.dumps(result)
    except Exception as error:
        return pickle.dumps(TaskError("refused", f"what the task gave cannot be sent back: {describe(error)}"))


def unpacked(received: bytes) -> Any:
    """What `answer` gave: the result, or a TaskError."""
    try:
        return pickle.loads(received)
    except Exception as error:
        return TaskError("refused", f"what the task gave cannot be read: {describe(error)}")


def _details() -> str:
    return traceback.format_exc()
