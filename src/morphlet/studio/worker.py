"""The one thread on which a session lives: commands in order, of a hand's places only the newest, the rest of the time for refinement."""

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

T = TypeVar("T")
Task = Callable[[], object]

PAUSE_SECONDS = 0.06
"""After a place of a hand, until there is time for anything but the next one: refinement that had begun would hold that one up.
Between two places of a hand that moves lie a screen's picture (17 ms) and the way of a frame to the page."""


class Worker:
    """A thread that does tasks in order; a task with a key replaces the one with the same key that still waits.

    Parameters
    ----------
    idle
        Called while there is nothing else to do, until it returns False.
    fault
        Told of what a task that nobody waits for, or `idle`, raised; the thread goes on.

    Examples
    --------
    >>> from morphlet.studio.worker import Worker
    >>> worker = Worker(lambda: False, print)
    >>> worker.ask(lambda: 6 * 7).result()
    42
    >>> worker.close()
    """

    def __init__(self, idle: Callable[[], bool], fault: Callable[[Exception], object]) -> None:
        self._idle, self._fault = idle, fault
        self._tasks: deque[Task] = deque()
        self._newest: dict[object, Task] = {}
        self._awake = threading.Condition()
        self._open = True
        self._thread = threading.Thread(target=self._run, name="morphlet-studio", daemon=True)
        self._thread.start()

    def put(self, task: Task) -> None:
        """Do a task once all before it are done."""
        with self._awake:
            self._tasks.append(task)
            self._awake.notify()

    def put_newest(self, key: object, task: Task) -> bool:
        """Do a task when no other waits, unless a newer one with this key comes before; whether it replaced an older one."""
        with self._awake:
            replaced = self._newest.pop(key, None) is not None
            self._newest[key] = task
            self._awake.notify()
        return replaced

    def forget(self, key: object) -> bool:
        """Drop what waits with this key; whether there was something."""
        with self._awake:
            return self._newest.pop(key, None) is not None

    def ask(self, task: Callable[[], T]) -> "Future[T]":
        """Do a task in order; its result comes later."""
        answer: Future[T] = Future()

        def work() -> None:
            try:
                answer.set_result(task())
            except BaseException as error:
                answer.set_exception(error)

        self.put(work)
        return answer

    @property
    def waiting(self) -> int:
        """Tasks in order that wait."""
        return len(self._tasks)

    def close(self) -> None:
        """Finish what waits in order, then end the thread."""
        with self._awake:
            self._open = False
            self._awake.notify()
        self._thread.join()

    def _run(self) -> None:
        restless, moved = True, False
        while True:
            with self._awake:
                if moved and not self._tasks and not self._newest and self._open:
                    self._awake.wait(PAUSE_SECONDS)
                while not self._tasks and not self._newest and not restless and self._open:
                    self._awake.wait()
                if not self._open and not self._tasks:
                    return
                moved = not self._tasks and bool(self._newest)
                task = self._next()
            try:
                restless = self._idle() if task is None else _did(task)
            except Exception as error:
                self._fault(error)
                restless = False

    def _next(self) -> Any:
        """The task that is next; None if there is none."""
        if self._tasks:
            return self._tasks.popleft()
        return self._newest.pop(next(iter(self._newest))) if self._newest else None


def _did(task: Task) -> bool:
    """Do a task; then there may be something to refine."""
    task()
    return True
