// A robot of YARP that moves along a line: its rpc port takes, in the words of many modules,
//
//   walk X             moves, and answers with the place once it is there
//   go X               begins to move, and answers with X at once; [fail] "too far" beyond 500
//   checkMotionDone    answers with the place, and 1 once it stands; a robot that moves takes a step then, so that whoever asks
//                      sees it moving, however slow the machine is
//
//   yarp_robot /base/rpc:i
//
// Lines on stdout: {"event": "ready"}. A line "home" on stdin puts the robot back to 0: {"event": "home"}. The end of stdin ends it.

#include <yarp/os/Bottle.h>
#include <yarp/os/ConnectionReader.h>
#include <yarp/os/ConnectionWriter.h>
#include <yarp/os/Network.h>
#include <yarp/os/PortReader.h>
#include <yarp/os/RpcServer.h>
#include <yarp/os/Vocab.h>

#include <atomic>
#include <chrono>
#include <iostream>
#include <string>
#include <thread>

namespace {

std::atomic<double> place{0.0};
std::atomic<double> target{0.0};
std::atomic<bool> leaving{false};

bool stands() { return place == target; }

void pause() { std::this_thread::sleep_for(std::chrono::milliseconds(20)); }

void step() {
    const double left = target - place;
    const double most = 0.05;
    place = left > most ? place + most : left < -most ? place - most : target.load();
}

// Each connection has a thread of its own.
class Words : public yarp::os::PortReader {
public:
    bool read(yarp::os::ConnectionReader& reader) override {
        yarp::os::Bottle asked, answer;
        if (!asked.read(reader)) return false;
        const std::string word = asked.get(0).asString();
        const double to = asked.get(1).asFloat64();
        if (word == "checkMotionDone") {
            answer.addFloat64(place);
            answer.addInt32(stands() ? 1 : 0);
            step();
        } else if (to > 500.0) {
            answer.addVocab32("fail");
            answer.addString("too far");
        } else if (word == "walk" || word == "go") {
            target = to;
            while (word == "walk" && !stands() && !leaving) pause();
            answer.addFloat64(word == "walk" ? place.load() : to);
        } else {
            answer.addVocab32("fail");
            answer.addString("no such word");
        }
        if (auto* writer = reader.getWriter()) answer.write(*writer);
        return true;
    }
};

void say(const char* event) { std::cout << "{\"event\": \"" << event << "\"}" << std::endl; }

}  // namespace

int main(int, char** argv) {
    yarp::os::Network network;
    yarp::os::RpcServer port;
    Words words;
    port.setReader(words);
    if (!argv[1] || !port.open(argv[1])) return 1;
    say("ready");
    for (std::string line; std::getline(std::cin, line);) {
        if (line == "home") {
            target = 0.0;
            place = 0.0;
            say("home");
        }
    }
    leaving = true;
    port.close();
}
