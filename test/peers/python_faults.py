"""What a script can do wrong with wrapyfi_rs, and the exception for each: a line each. Everything is in one process."""
import logging
import queue

import numpy as np

from wrapyfi_rs import _native
from wrapyfi_rs.connect.wrapper import MiddlewareCommunicator as Base

register = Base.register
#: Ports at which there is nobody.
NO_BROKER = {"start_proxy_broker": False, "socket_pub_port": 9, "socket_sub_port": 10, "socket_rep_port": 11}


def tell(name, action):
    try:
        print(f"{name}: {action()}")
    except Exception as error:
        notes = "".join(f" ({note})" for note in getattr(error, "__notes__", ()))
        print(f"{name}: {type(error).__name__}{notes}")


class Pair(Base):
    """A value goes out by `say` and comes back by `hear`."""

    value = None

    @register("NativeObject", "zeromq", "Pair", "/faults/object", should_wait=True)
    def say(self):
        return self.value,

    @register("NativeObject", "zeromq", "Pair", "/faults/object", should_wait=True)
    def hear(self):
        raise AssertionError("a listener's method does not run")


class Faults(Base):
    @register("NativeObject", "zeromq", "Faults", "/faults/a", should_wait=False)
    def no_tuple(self):
        return {"a": 1}

    @register("NativeObject", "zeromq", "Faults", "/faults/a", should_wait=False)
    def too_many(self):
        return 1, 2

    @register("NativeObject", "zeromq", "Faults", "/faults/a", should_wait=False)
    def generator(self):
        yield 1

    @register("Image", "zeromq", "Faults", "/faults/image", should_wait="$0")
    def image(self, wait):
        return np.zeros((2, 3, 3), np.float64),

    @register("AudioChunk", "zeromq", "Faults", "/faults/sound", should_wait="$0")
    def sound(self, wait):
        return np.zeros((2, 2), np.float32),

    @register("NativeObject", "zeromq", "Faults", "/faults/a", should_wait=False)
    def raises(self):
        return 1 / 0,

    @staticmethod
    @register("NativeObject", "zeromq", "Faults", "/faults/a", should_wait=False)
    def static(number):
        return number

    @register("NativeObject", "zeromq", "Faults", "$nowhere", should_wait=False)
    def argument(self):
        return 1,

    @register("NativeObject", "$3", "Faults", "/faults/a", should_wait=False)
    def place(self, first):
        return first,

    @register("NativeObject", "carrier_pigeon", "Faults", "/faults/a", should_wait=False)
    def pigeon(self):
        return 1,

    @register("NativeObject", "yarp", "Faults", "/faults/a", should_wait=False)
    def absent(self):
        return 1,

    @register("NativeObject", "zeromq", "Faults", "/faults/silent", should_wait=True, timeout_ms=50)
    def silent(self):
        return 1,

    @register("NativeObject", "zeromq", "Faults", "/faults/alone", should_wait="$0", timeout_ms=50, **NO_BROKER)
    def alone(self, wait):
        return "alone",

    @register("NativeObject", "zeromq", "Faults", "/faults/a", should_wait=False)
    def own(self):
        return "own"


def in_mode(name, mode, *args):
    faults = Faults()
    faults.activate_communication(name, mode)
    return getattr(faults, name)(*args)


def to_listener(name):
    """Publishes to a listener."""
    listener = Faults()
    listener.activate_communication(name, "listen")
    getattr(listener, name)(False)
    return in_mode(name, "publish", True)


def main():
    for name in ("no_tuple", "too_many", "generator"):
        tell(name.replace("_", " "), lambda: in_mode(name, "publish"))

    import threading

    said, heard = Pair(), Pair()
    heard.activate_communication("hear", "listen")
    said.activate_communication("say", "publish")
    answers = []
    listener = threading.Thread(target=lambda: [answers.append(heard.hear()[0]) for _ in range(4)])
    listener.start()
    said.value = "first"
    said.say()
    cycle = []
    cycle.append(cycle)
    wrong = {"object": object(), "cycle": cycle, "objects": np.array([object()]), "bytes": b"raw"}
    for name, value in wrong.items():
        said.value = value
        tell(name, said.say)
    right = [np.arange(6)[::2], np.array([1, 2], ">i4"), 10**400]
    for value in right:
        said.value = value
        said.say()
    listener.join()
    print("strided:", answers[1].tolist())
    print("big-endian:", answers[2].tolist())
    print("huge:", answers[3] == 10**400)

    tell("image of float64", lambda: to_listener("image"))
    tell("sound", lambda: to_listener("sound"))
    tell("raises", lambda: in_mode("raises", "publish"))
    tell("static", lambda: Faults.static(5))
    tell("mode", lambda: in_mode("own", "pulbish"))
    tell("name", lambda: in_mode("owm", "publish"))
    tell("argument", lambda: in_mode("argument", "publish"))
    tell("place", lambda: in_mode("place", "publish", 1))
    tell("list", lambda: in_mode("own", []))
    tell("unknown middleware", lambda: in_mode("pigeon", "listen"))
    lines = queue.Queue()
    kept = type("Kept", (logging.Handler,), {"emit": lambda _, record: lines.put((record.levelname, record.getMessage()))})
    logging.getLogger("wrapyfi_rs").addHandler(kept())

    def warned(word):
        """Level of the next line with a word, which a thread brings."""
        while True:
            level, text = lines.get(timeout=100)
            if word in text:
                return level

    tell("middleware without a name server", lambda: (in_mode("absent", "listen"), warned("middleware yarp is not available")))
    register("NativeObject", "zeromq", "Typo", "/typo", should_wiat=True, listener_kwargs={"timeout": 5, "timeout_m": 5})
    tell("misspelt options", lambda: (warned("'should_wiat' is no option"), warned("did you mean 'timeout_ms'")))
    tell("time-out", lambda: in_mode("silent", "listen"))
    for mode in ("listen", "publish", "request"):
        tell(f"no broker, {mode}", lambda: in_mode("alone", mode, True))
    tell("no broker, none is waited for", lambda: in_mode("alone", "publish", False))
    tell("panic", _native.panic_on_purpose)
    closed = Faults()
    closed.activate_communication("own", "listen")
    closed.close()
    tell("closed", closed.own)

    def same_name(answer):
        class Twin(Base):
            @register("NativeObject", "zeromq", "Twin", f"/faults/{answer}")
            def say(self):
                return answer

        return Twin().say()

    tell("two classes", lambda: f"{same_name('a')} {same_name('b')}")


if __name__ == "__main__":
    main()
