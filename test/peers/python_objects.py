"""Every object of plugins.py from one method to another on wrapyfi_rs: a line for each that arrives as another one."""
import threading

import plugins
from wrapyfi_rs.connect.wrapper import MiddlewareCommunicator


class Objects(MiddlewareCommunicator):
    value = None

    @MiddlewareCommunicator.register("NativeObject", "zeromq", "Objects", "/objects")
    def carry(self):
        return self.value,


here, there = Objects(), Objects()
here.activate_communication("carry", "publish")
there.activate_communication("carry", "listen")
for name, case in plugins.CASES.items():
    here.value = case.make(3)
    heard = []
    listener = threading.Thread(target=lambda: heard.extend(there.carry()))
    listener.start()
    here.carry()
    listener.join()
    # A palette has no form in a message: the picture comes in its colours.
    sent = here.value.convert("RGB") if name == "pillowp" else here.value
    if case.facts(heard[0]) != case.facts(sent):
        print(name, type(heard[0]), case.facts(heard[0]), case.facts(sent))
print(len(plugins.CASES) > 30)
