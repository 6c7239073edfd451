"""Every object that the end-to-end tests send through Wrapyfi's plug-ins, written and read here."""

import pathlib
import sys
import unittest

from wrapyfi_py import MessageError

from .stand_ins import missing, travels, write

PEERS = pathlib.Path(__file__).resolve().parents[2] / "test" / "peers"

#: Cases that are refused, and the words that say why: a palette would be lost.
REFUSED = {"pillowp": 'convert("RGB")'}

NOT_HERE = missing("pandas", "pyarrow", "PIL", "xarray", "pint")


@unittest.skipIf(NOT_HERE or not PEERS.is_dir(), NOT_HERE or f"there is no {PEERS}")
class PlugIns(unittest.TestCase):
    def test_every_object_returns_as_it_was(self):
        sys.path.insert(0, str(PEERS))
        self.addCleanup(sys.path.remove, str(PEERS))
        import plugins

        self.assertGreater(len(plugins.CASES), 25)
        for name, case in plugins.CASES.items():
            for seq in range(12):
                with self.subTest(case=name, seq=seq):
                    sent = case.make(seq)
                    if name in REFUSED:
                        with self.assertRaises(MessageError) as caught:
                            write(sent)
                        self.assertIn(REFUSED[name], str(caught.exception))
                        continue
                    self.assertEqual(case.facts(travels(sent)), case.facts(sent))


if __name__ == "__main__":
    unittest.main()
