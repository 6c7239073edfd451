"""Tensors of a library of frameworks.py from one method to another on wrapyfi_rs: names of those that arrive as others."""
import sys
import threading

import frameworks  # noqa: F401, the cases are plugins.CASES
import plugins
from wrapyfi_rs.connect.wrapper import MiddlewareCommunicator

DEVICES = {f"load_{library}_device": "cpu" for library in ("torch", "paddle")}


class Tensors(MiddlewareCommunicator):
    value = None

    @MiddlewareCommunicator.register("NativeObject", "zeromq", "Tensors", "/tensors", **DEVICES)
    def carry(self):
        return self.value,


case = plugins.CASES[sys.argv[1]]
before = getattr(case, "before", None)
if before:
    before()
here, there = Tensors(), Tensors()
here.activate_communication("carry", "publish")
there.activate_communication("carry", "listen")
here.value, heard = case.make(3), []
listener = threading.Thread(target=lambda: heard.extend(there.carry()))
listener.start()
here.carry()
listener.join()
sent, found = case.facts(here.value), case.facts(heard[0])
print(", ".join(f"{name}: {found.get(name)} for {sent[name]}" for name in sent if found.get(name) != sent[name]) or "all")
