#!/usr/bin/env python3
"""A microphone or a loudspeaker, the twin of examples/communicator/src/bin/microphone.rs. Both are WAV files
of 16-bit integers.

    python test/peers/microphone.py --mode publish --source voice.wav
    python test/peers/microphone.py --mode listen --play heard.wav
"""
import argparse
import time
import wave

import example  # before wrapyfi
import numpy as np
from wrapyfi.connect.wrapper import MiddlewareCommunicator

from lines import say

parser = argparse.ArgumentParser()
parser.add_argument("--mode", default=None)
parser.add_argument("--mware", default="zeromq")
parser.add_argument("--topic", default="/sensors/microphone")
parser.add_argument("--source", help="WAV file")
parser.add_argument("--once", action="store_true")
parser.add_argument("--play", help="WAV file to write")
parser.add_argument("--channels", type=int, default=1, help="a listener of Wrapyfi has to know them")
parser.add_argument("--chunk", type=int, default=1600)
args = parser.parse_args()

rate, samples = -1, None
if args.source:
    with wave.open(args.source) as file:
        rate, args.channels = file.getframerate(), file.getnchannels()
        samples = np.frombuffer(file.readframes(file.getnframes()), "<i2").astype(np.float32) / np.float32(32768)
    samples = samples.reshape(-1, args.channels)
    samples = np.pad(samples, ((0, -len(samples) % args.chunk), (0, 0)))


class Ear(MiddlewareCommunicator):
    used = 0

    @MiddlewareCommunicator.register("AudioChunk", "$mware", "Ear", "$topic", carrier="tcp", rate=-1, chunk=-1,
                                     channels="$channels")
    def hear(self, mware=None, topic=None, channels=1):
        first, self.used = self.used, self.used + 1
        start = first * args.chunk % len(samples)
        return (samples[start:start + args.chunk], rate),


def main():
    ear = Ear()
    ear.activate_communication("hear", mode=args.mode)
    player = wave.open(args.play, "wb") if args.play else None
    heard = 0
    while args.mode == "listen" or not args.once or heard * args.chunk < len(samples):
        sound, = ear.hear(mware=args.mware, topic=args.topic, channels=args.channels)
        if sound is not None and sound[0] is not None:
            if player:
                chunk = sound[0].reshape(len(sound[0]), -1)
                if heard == 0:
                    player.setnchannels(chunk.shape[1])
                    player.setsampwidth(2)
                    player.setframerate(int(sound[1]))
                scaled = np.clip(np.round(chunk * 32768), -32768, 32767)
                player.writeframes(scaled.astype("<i2").tobytes())  # mends the header each time
                player._file.flush()
            heard += 1
            say("message", **example.sound_facts(sound))
        time.sleep(0.005 if args.mode == "listen" else args.chunk / rate)
    example.leave_after_the_last_message()


if __name__ == "__main__":
    main()
