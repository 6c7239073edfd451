// One end on rclcpp for ros2_side_by_side.py: what ros2_ends does, with generic publishers and typed services.
//
//   rclcpp_ends relay FROM TO TYPE DEPTH RELIABLE     ends when stdin does
//   rclcpp_ends serve NAME BYTES                      std_srvs/srv/Trigger with a message of so many bytes
//   rclcpp_ends call  NAME COUNT
#include <chrono>
#include <cstdio>
#include <iostream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <rclcpp/rclcpp.hpp>
#include <std_srvs/srv/trigger.hpp>

using namespace std::chrono_literals;
using Trigger = std_srvs::srv::Trigger;

static void say(const std::string & text)
{
  std::cout << text << std::endl;
}

// Ends the program when its stdin ends.
static void watch_stdin()
{
  std::thread([] {
    while (std::getchar() != EOF) {}
    rclcpp::shutdown();
  }).detach();
}

int main(int argc, char ** argv)
{
  const std::vector<std::string> args(argv + 1, argv + argc);
  rclcpp::init(1, argv);
  auto node = std::make_shared<rclcpp::Node>("rclcpp_ends");
  if (args.at(0) == "relay") {
    rclcpp::QoS qos(std::stoul(args.at(4)));
    if (args.at(5) == "0") {qos.best_effort();}
    auto publisher = node->create_generic_publisher(args.at(2), args.at(3), qos);
    auto subscription = node->create_generic_subscription(
      args.at(1), args.at(3), qos,
      [publisher](std::shared_ptr<rclcpp::SerializedMessage> message) {publisher->publish(*message);});
    watch_stdin();
    say("{\"ready\": true}");
    rclcpp::spin(node);
  } else if (args.at(0) == "serve") {
    const std::string message(std::stoul(args.at(2)), 'x');
    auto server = node->create_service<Trigger>(
      args.at(1), [&message](const Trigger::Request::SharedPtr, Trigger::Response::SharedPtr reply) {
        reply->success = true;
        reply->message = message;
      });
    watch_stdin();
    say("{\"ready\": true}");
    rclcpp::spin(node);
  } else {
    auto client = node->create_client<Trigger>(args.at(1));
    if (!client->wait_for_service(60s)) {return 1;}
    auto start = std::chrono::steady_clock::now();
    std::string times;
    for (unsigned long number = 0; number < std::stoul(args.at(2)); ++number) {
      if (number > 0) {start = std::chrono::steady_clock::now();}
      auto reply = client->async_send_request(std::make_shared<Trigger::Request>());
      if (rclcpp::spin_until_future_complete(node, reply, 60s) != rclcpp::FutureReturnCode::SUCCESS) {return 1;}
      const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
      times += (number ? ", " : "") + std::to_string(took.count());
    }
    say("{\"times\": [" + times + "]}");
  }
  rclcpp::shutdown();
  return 0;
}
