// A SimpleActionServer and a SimpleActionClient of actionlib in C++, of actionlib/Test.
//
//     actionlib_cpp serve --topic /x                            counts to its goal; aborts one below zero
//     actionlib_cpp ask   --topic /x --goal N [--cancel AT]     cancels at feedback AT
//
//   test ─ arguments ─▶ node ═ five topics ═▶ the program under test ═▶ node ─▶ stdout, JSON lines
//
// The lines are those of actionlib_peer.py. It leaves at SIGTERM or when stdin closes.
#include <map>
#include <stdexcept>
#include <string>

#include <actionlib/TestAction.h>
#include <actionlib/client/simple_action_client.h>
#include <actionlib/server/simple_action_server.h>
#include <ros/ros.h>

#include "../ros1_cpp/talk.hpp"

using Client = actionlib::SimpleActionClient<actionlib::TestAction>;
using Server = actionlib::SimpleActionServer<actionlib::TestAction>;

std::map<std::string, std::string> arguments;

std::string argument(const std::string& name, const std::string& otherwise) {
    const auto found = arguments.find(name);
    return found == arguments.end() ? otherwise : found->second;
}

Facts value(int number) { return {{"value", std::to_string(number)}}; }

void until_left() {
    while (!leaving) {
        ros::WallDuration(0.01).sleep();
    }
}

void serve(ros::NodeHandle& node) {
    Server* running = nullptr;
    auto execute = [&](const actionlib::TestGoalConstPtr& goal) {
        say("goal", value(goal->goal));
        actionlib::TestResult result;
        for (int at = 1; at <= goal->goal; ++at) {
            result.result = at;
            if (running->isPreemptRequested() || leaving) {
                say("preempted");
                return running->setPreempted(result, "given up");
            }
            actionlib::TestFeedback feedback;
            feedback.feedback = at;
            running->publishFeedback(feedback);
            ros::WallDuration(0.05).sleep();
        }
        result.result = goal->goal;
        goal->goal < 0 ? running->setAborted(result, "below zero") : running->setSucceeded(result, "counted");
    };
    Server server(node, argument("--topic", "/x"), execute, false);
    running = &server;
    server.start();
    say("ready");
    until_left();
}

void ask() {
    Client client(argument("--topic", "/x"), false);
    say("ready");
    while (!client.waitForServer(ros::Duration(0.1))) {
        if (leaving) {
            return;
        }
    }
    say("server");
    const int cancel = std::stoi(argument("--cancel", "-1"));
    auto heard = [&](const actionlib::TestFeedbackConstPtr& feedback) {
        say("feedback", value(feedback->feedback));
        if (feedback->feedback == cancel) {
            client.cancelGoal();
        }
    };
    auto ended = [](const actionlib::SimpleClientGoalState& state, const actionlib::TestResultConstPtr& result) {
        say("ended", {{"state", quoted(state.toString())},
                      {"text", quoted(state.getText())},
                      {"result", result ? std::to_string(result->result) : "null"}});
    };
    actionlib::TestGoal goal;
    goal.goal = std::stoi(argument("--goal", "3"));
    client.sendGoal(goal, ended, Client::SimpleActiveCallback(), heard);
    until_left();
}

int main(int argc, char** argv) {
    try {
        if (argc < 2) {
            throw std::invalid_argument("a role is needed");
        }
        for (int at = 2; at + 1 < argc; at += 2) {
            arguments[argv[at]] = argv[at + 1];
        }
        watch_stdin();
        ros::init(ros::M_string(), argument("--node", "actionlib_cpp"), ros::init_options::NoSigintHandler);
        ros::NodeHandle node;
        // Callbacks come on a thread of their own, as in most programs.
        ros::AsyncSpinner spinner(2);
        spinner.start();
        std::string(argv[1]) == "serve" ? serve(node) : ask();
        ros::shutdown();
    } catch (const std::exception& problem) {
        std::fprintf(stderr, "actionlib_cpp: %s\n", problem.what());
        return 1;
    }
    return 0;
}
