"""A cable that can be cut or held: TCP through the harness, from a process to the router."""

import contextlib
import socket
import threading


class Gate:
    """Listens on a port of its own and passes everything on, both ways, while it is open."""

    def __init__(self, port: int) -> None:
        self._target = ("127.0.0.1", port)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._listener.getsockname()[1]}"
        self._flows = threading.Event()
        self._flows.set()
        self._cut = False
        self._ends: set[socket.socket] = set()
        self._lock = threading.Lock()
        threading.Thread(target=self._accept, daemon=True).start()

    def set(self, *, cut: bool, stalled: bool) -> None:
        """Cut: connections are reset and none is taken. Stalled: they stand, nothing moves."""
        with self._lock:
            self._cut = cut
            ends = list(self._ends) if cut else []
        for end in ends:
            _end(end)
        (self._flows.clear if stalled else self._flows.set)()

    def close(self) -> None:
        """Cut for good."""
        self.set(cut=True, stalled=False)
        _end(self._listener)
        self._listener.close()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            try:
                far = socket.create_connection(self._target, timeout=2.0)
            except OSError:
                near.close()
                continue
            far.settimeout(None)
            with self._lock:
                open_ = not self._cut
                if open_:
                    self._ends |= {near, far}
            if not open_:
                near.close()
                far.close()
                continue
            for source, sink in ((near, far), (far, near)):
                threading.Thread(target=self._pump, args=(source, sink), daemon=True).start()

    def _pump(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                self._flows.wait()
                sink.sendall(data)
        with self._lock:
            self._ends -= {source, sink}
        for end in (source, sink):
            _end(end)
            end.close()


def _end(end: socket.socket) -> None:
    with contextlib.suppress(OSError):
        end.shutdown(socket.SHUT_RDWR)
