// A node of roscpp.
//
//     ros1_cpp publish   --topic /x --type std_msgs/String --value 'number {n}' [--latch] [--rate HZ]
//     ros1_cpp publish   --topic /x --type sensor_msgs/Image --width W --height H
//     ros1_cpp subscribe --topic /x --type std_msgs/String [--count N]
//     ros1_cpp serve     --topic /x                       std_srvs/SetBool: succeeds with true
//     ros1_cpp call      --topic /x --count N [--persistent]     asks true and false by turns
//
//   test ─ arguments ─▶ node ═ TCPROS of roscpp ═▶ the program under test ═▶ node ─▶ stdout, JSON lines
//
// `--node` is its name. In a published text {n} stands for the number of the message; the pixels of an
// image follow from its number (`pixel`). Lines on stdout: `ready`, `message`, `reply`, `done`. It leaves at
// SIGTERM or when stdin closes, and sends until then, or `--count` messages.
#include <cstdlib>
#include <map>
#include <stdexcept>
#include <string>

#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/String.h>
#include <std_srvs/SetBool.h>

#include "talk.hpp"

using Arguments = std::map<std::string, std::string>;

Arguments arguments;

std::string argument(const std::string& name, const std::string& otherwise) {
    const auto found = arguments.find(name);
    return found == arguments.end() ? otherwise : found->second;
}

unsigned number(const std::string& name, unsigned otherwise) {
    return static_cast<unsigned>(std::stoul(argument(name, std::to_string(otherwise))));
}

bool flag(const std::string& name) { return arguments.count(name) > 0; }

/// A byte of image `index`: the test makes the same.
uint8_t pixel(unsigned index, size_t at) { return static_cast<uint8_t>((at * 31 + at / 251 + index) % 256); }

/// FNV-1a of 64 bits, in hex.
std::string print(const std::vector<uint8_t>& bytes) {
    uint64_t hash = 0xcbf29ce484222325;
    for (uint8_t byte : bytes) {
        hash = (hash ^ byte) * 0x100000001b3;
    }
    char text[17];
    std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash));
    return text;
}

void make(std_msgs::String& message, unsigned index) {
    message.data = argument("--value", "{n}");
    const size_t at = message.data.find("{n}");
    if (at != std::string::npos) {
        message.data.replace(at, 3, std::to_string(index));
    }
}

void make(sensor_msgs::Image& message, unsigned index) {
    message.header.frame_id = "camera";
    message.header.stamp = ros::Time(5, index);
    message.width = number("--width", 8);
    message.height = number("--height", 8);
    message.encoding = "bgr8";
    message.step = message.width * 3;
    message.data.resize(static_cast<size_t>(message.step) * message.height);
    for (size_t at = 0; at < message.data.size(); ++at) {
        message.data[at] = pixel(index, at);
    }
}

Facts facts(const std_msgs::String& message) { return {{"value", quoted(message.data)}}; }

Facts facts(const sensor_msgs::Image& message) {
    return {{"width", std::to_string(message.width)},
            {"height", std::to_string(message.height)},
            {"encoding", quoted(message.encoding)},
            {"frame_id", quoted(message.header.frame_id)},
            {"nsec", std::to_string(message.header.stamp.nsec)},
            {"size", std::to_string(message.data.size())},
            {"fnv", quoted(print(message.data))}};
}

void tell(unsigned index, Facts found) {
    found.insert(found.begin(), {"index", std::to_string(index)});
    say("message", found);
}

template <class Message>
void publish(ros::NodeHandle& node) {
    const bool latch = flag("--latch");
    const unsigned count = number("--count", 0);
    auto publisher = node.advertise<Message>(argument("--topic", "/x"), 100, latch);
    say("ready");
    ros::WallRate rate(std::stod(argument("--rate", "20")));
    for (unsigned index = 0; !leaving && (count == 0 || index < count);) {
        // A latched message is kept; another would be lost.
        if (latch || publisher.getNumSubscribers() > 0) {
            Message message;
            make(message, index);
            publisher.publish(message);
            tell(index, facts(message));
            ++index;
        }
        rate.sleep();
    }
    say("done");
    while (!leaving) {
        ros::WallDuration(0.01).sleep();
    }
}

template <class Message>
void subscribe(ros::NodeHandle& node) {
    const unsigned count = number("--count", 0);
    unsigned index = 0;
    boost::function<void(const boost::shared_ptr<const Message>&)> heard =
        [&](const boost::shared_ptr<const Message>& message) {
            if (count == 0 || index < count) {
                tell(index++, facts(*message));
            }
        };
    auto subscriber =
        node.subscribe<Message>(argument("--topic", "/x"), 1000, heard, ros::VoidConstPtr(),
                                ros::TransportHints().tcpNoDelay());
    say("ready");
    while (!leaving && (count == 0 || index < count)) {
        ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.02));
    }
    say("done");
}

void serve(ros::NodeHandle& node) {
    boost::function<bool(std_srvs::SetBool::Request&, std_srvs::SetBool::Response&)> answer =
        [](std_srvs::SetBool::Request& request, std_srvs::SetBool::Response& response) {
            say("message", {{"value", json(request.data != 0)}});
            response.success = request.data;
            response.message = request.data ? "so be it" : "no";
            return true;
        };
    auto server = node.advertiseService(argument("--topic", "/x"), answer);
    say("ready");
    while (!leaving) {
        ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.02));
    }
}

void call(ros::NodeHandle& node) {
    const std::string name = argument("--topic", "/x");
    say("ready");
    while (!leaving && !ros::service::waitForService(name, ros::Duration(0.1))) {
    }
    auto client = node.serviceClient<std_srvs::SetBool>(name, flag("--persistent"));
    for (unsigned index = 0; !leaving && index < number("--count", 1); ++index) {
        std_srvs::SetBool service;
        service.request.data = index % 2 == 0;
        const bool worked = client.call(service);
        const bool success = service.response.success != 0;
        const std::string message = service.response.message;
        say("reply", {{"index", std::to_string(index)},
                      {"worked", json(worked)},
                      {"success", json(success)},
                      {"message", quoted(message)}});
    }
    say("done");
}

void run(const std::string& role) {
    ros::NodeHandle node;
    const std::string type = argument("--type", "std_msgs/String");
    const bool image = type == "sensor_msgs/Image";
    if (!image && type != "std_msgs/String") {
        throw std::invalid_argument("no type " + type + " here");
    }
    if (role == "publish") {
        image ? publish<sensor_msgs::Image>(node) : publish<std_msgs::String>(node);
    } else if (role == "subscribe") {
        image ? subscribe<sensor_msgs::Image>(node) : subscribe<std_msgs::String>(node);
    } else if (role == "serve") {
        serve(node);
    } else if (role == "call") {
        call(node);
    } else {
        throw std::invalid_argument("no role " + role);
    }
}

int main(int argc, char** argv) {
    try {
        if (argc < 2) {
            throw std::invalid_argument("a role is needed");
        }
        for (int at = 2; at < argc; ++at) {
            const std::string name = argv[at];
            const bool is_flag = name == "--latch" || name == "--persistent";
            if (!is_flag && at + 1 == argc) {
                throw std::invalid_argument(name + " needs a value");
            }
            arguments[name] = is_flag ? "" : argv[++at];
        }
        watch_stdin();
        // Only what ROS reads itself: names of topics come as they are.
        ros::init(ros::M_string(), argument("--node", "ros1_cpp"), ros::init_options::NoSigintHandler);
        run(argv[1]);
        ros::shutdown();
    } catch (const std::exception& problem) {
        std::fprintf(stderr, "ros1_cpp: %s\n", problem.what());
        return 1;
    }
    return 0;
}
