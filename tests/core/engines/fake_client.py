"""Client of dask that runs in this process: everything is pickled, and tasks run in random order."""

import itertools
import pickle
import random
import threading


class FakeFuture:
    """Future of a task; as an argument of other tasks it stands for its result."""

    def __init__(self, key):
        self.key, self.ended, self.content, self.callbacks = key, threading.Event(), None, []
        self.failed = False

    def result(self):
        self.ended.wait()
        content = pickle.loads(self.content)
        if self.failed:
            raise content
        return content

    def add_done_callback(self, callback):
        self.callbacks.append(callback)
        if self.ended.is_set():
            callback(self)


class FakeClient:
    """Runs one task at a time, when the next result is waited for: any of those that were submitted."""

    asynchronous = False

    def __init__(self, workers=2, *, seed=0, surroundings=None):
        self.addresses = [f"tcp://10.0.0.{i}:8000" for i in range(workers)]
        self.random, self.numbers, self.surroundings = random.Random(seed), itertools.count(), surroundings
        self.waiting, self.calls, self.cancelled, self.most = [], [], [], 0
        self.lock, self.closed = threading.Condition(), False
        threading.Thread(target=self._work, daemon=True).start()

    def nthreads(self):
        return dict.fromkeys(self.addresses, 1)

    def run(self, function, on_error):
        assert on_error == "return"
        return {address: function() if self.surroundings is None else self.surroundings for address in self.addresses}

    def submit(self, function, *arguments, pure, retries=0, **placed):
        assert not pure
        future = FakeFuture(f"{function.__name__}-{next(self.numbers)}")
        given = [one if isinstance(one, FakeFuture) else pickle.dumps(one) for one in arguments]
        with self.lock:
            self.calls.append(function.__name__)
            self.waiting.append((future, function, given))
            self.most = max(self.most, len(self.waiting))
            self.lock.notify()
        return future

    def cancel(self, futures):
        with self.lock:
            self.cancelled += [future.key for future in futures]
            self.waiting = [task for task in self.waiting if task[0] not in futures]

    def close(self):
        with self.lock:
            self.closed = True
            self.lock.notify()

    def _work(self):
        while True:
            with self.lock:
                self.lock.wait_for(lambda: self.closed or self._ready())
                if self.closed:
                    return
                task = self.random.choice(self._ready())
                self.waiting.remove(task)
            future, function, given = task
            try:
                arguments = [one.result() if isinstance(one, FakeFuture) else pickle.loads(one) for one in given]
                future.content = pickle.dumps(function(*arguments))
            except BaseException as error:
                future.content, future.failed = pickle.dumps(error), True
            future.ended.set()
            for callback in future.callbacks:
                callback(future)

    def _ready(self):
        """Tasks of which all that they need is there."""
        return [
            task for task in self.waiting if all(one.ended.is_set() for one in task[2] if isinstance(one, FakeFuture))
        ]
