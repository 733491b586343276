"""Drags files onto a window as a file manager does: the XDND protocol, version 5, with a real pointer.

usage: drag_source.py WINDOW_X WINDOW_Y FILE...   (where to let go, in pixels of the screen)
"""
import os
import sys
import time
import urllib.parse

from Xlib import X, Xatom, display
from Xlib.ext import xtest
from Xlib.protocol import event


PATIENCE = 60.0  # seconds for an answer: nobody waits for them, unless the window hangs


class DragSource:
    def __init__(self, files):
        self.files = files
        self.display = display.Display()
        self.root = self.display.screen().root
        self.window = self.root.create_window(0, 0, 40, 40, 0, self.display.screen().root_depth,
                                              event_mask=X.PropertyChangeMask)
        self.atoms = {name: self.display.intern_atom(name) for name in (
            "XdndSelection", "XdndAware", "XdndEnter", "XdndPosition", "XdndStatus", "XdndDrop", "XdndFinished",
            "XdndActionCopy", "text/uri-list", "TARGETS")}

    def aware_window_at(self, x, y):
        """The innermost window under a point that takes drops."""
        window, found = self.root, None
        while window:
            if window.get_full_property(self.atoms["XdndAware"], X.AnyPropertyType):
                found = window
            child = window.translate_coords(self.root, x, y).child
            window = child if child else None
        return found

    def send(self, target, name, data):
        message = event.ClientMessage(window=target, client_type=self.atoms[name], data=(32, data))
        target.send_event(message, event_mask=0)
        self.display.flush()

    def answer_request(self, request):
        uris = "".join("file://" + urllib.parse.quote(os.path.abspath(f)) + "\r\n" for f in self.files)
        if request.target == self.atoms["text/uri-list"]:
            request.requestor.change_property(request.property, request.target, 8, uris.encode())
            where = request.property
        elif request.target == self.atoms["TARGETS"]:
            request.requestor.change_property(request.property, Xatom.ATOM, 32, [self.atoms["text/uri-list"]])
            where = request.property
        else:
            where = X.NONE
        notify = event.SelectionNotify(time=request.time, requestor=request.requestor, selection=request.selection,
                                       target=request.target, property=where)
        request.requestor.send_event(notify)
        self.display.flush()

    def wait_for(self, name, seconds):
        """The data of the next message of this name; answers requests for the files meanwhile."""
        end = time.time() + seconds
        while time.time() < end:
            while self.display.pending_events():
                e = self.display.next_event()
                if e.type == X.SelectionRequest:
                    self.answer_request(e)
                elif e.type == X.ClientMessage and e.client_type == self.atoms[name]:
                    return e.data[1]
            time.sleep(0.005)
        return None

    def drop(self, x, y):
        target = self.aware_window_at(x, y)
        if target is None:
            sys.exit(f"no window at {x},{y} takes drops")
        self.window.set_selection_owner(self.atoms["XdndSelection"], X.CurrentTime)
        xtest.fake_input(self.display, X.MotionNotify, x=x, y=y)
        self.display.sync()
        self.send(target, "XdndEnter", [self.window.id, 5 << 24, self.atoms["text/uri-list"], 0, 0])
        for _ in range(3):
            self.send(target, "XdndPosition", [self.window.id, 0, (x << 16) | y, X.CurrentTime,
                                               self.atoms["XdndActionCopy"]])
            status = self.wait_for("XdndStatus", PATIENCE)
            if status is None:
                sys.exit("the window did not answer a drag over it")
        if not status[1] & 1:
            sys.exit("the window refuses the drop")
        self.send(target, "XdndDrop", [self.window.id, 0, X.CurrentTime, 0, 0])
        if self.wait_for("XdndFinished", PATIENCE) is None:
            sys.exit("the window did not finish the drop")


if __name__ == "__main__":
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    DragSource(sys.argv[3:]).drop(int(sys.argv[1]), int(sys.argv[2]))
