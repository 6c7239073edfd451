// One end on rcl for ros2_side_by_side.py: what ros2_ends does, with serialised messages and a typed service. rclcpp
// and rclpy stand on rcl, so that a limit against this program is stricter than one against them.
//
//   rcl_ends relay FROM TO TYPE DEPTH RELIABLE     ends when stdin does
//   rcl_ends serve NAME BYTES                      std_srvs/srv/Trigger with a message of so many bytes
//   rcl_ends call  NAME COUNT
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include <rcl/error_handling.h>
#include <rcl/graph.h>
#include <rcl/rcl.h>
#include <rosidl_runtime_c/string_functions.h>
#include <sensor_msgs/msg/image.h>
#include <sensor_msgs/msg/joint_state.h>
#include <sensor_msgs/msg/point_cloud2.h>
#include <std_srvs/srv/trigger.h>

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

static std::atomic<bool> ends{false};
static rcl_context_t context = rcl_get_zero_initialized_context();
static rcl_node_t node = rcl_get_zero_initialized_node();
static rcl_guard_condition_t leaving = rcl_get_zero_initialized_guard_condition();
static rcl_wait_set_t waiting = rcl_get_zero_initialized_wait_set();

static void check(rcl_ret_t code)
{
  if (code != RCL_RET_OK) {
    std::fprintf(stderr, "%s\n", rcl_get_error_string().str);
    std::exit(1);
  }
}

static void say(const std::string & text)
{
  std::printf("%s\n", text.c_str());
  std::fflush(stdout);
}

// Ends the program when its stdin ends.
static void watch_stdin()
{
  std::thread(
    [] {
      while (std::getchar() != EOF) {}
      ends = true;
      check(rcl_trigger_guard_condition(&leaving));
    }).detach();
  say("{\"ready\": true}");
}

// True when what `add` puts into the wait set is ready; false after a minute, or when the program ends.
template<typename Add>
static bool is_ready(Add add)
{
  check(rcl_wait_set_clear(&waiting));
  add();
  check(rcl_wait_set_add_guard_condition(&waiting, &leaving, nullptr));
  const rcl_ret_t code = rcl_wait(&waiting, 60'000'000'000);
  return code == RCL_RET_OK && !ends;
}

static const rosidl_message_type_support_t * type_named(const std::string & name)
{
  if (name == "sensor_msgs/msg/Image") {return ROSIDL_GET_MSG_TYPE_SUPPORT(sensor_msgs, msg, Image);}
  if (name == "sensor_msgs/msg/PointCloud2") {
    return ROSIDL_GET_MSG_TYPE_SUPPORT(sensor_msgs, msg, PointCloud2);
  }
  return ROSIDL_GET_MSG_TYPE_SUPPORT(sensor_msgs, msg, JointState);
}

static void relay(const std::vector<std::string> & args)
{
  const auto * type = type_named(args.at(3));
  auto to_subscribe = rcl_subscription_get_default_options();
  auto to_publish = rcl_publisher_get_default_options();
  to_subscribe.qos.depth = to_publish.qos.depth = std::stoul(args.at(4));
  if (args.at(5) == "0") {
    to_subscribe.qos.reliability = to_publish.qos.reliability = RMW_QOS_POLICY_RELIABILITY_BEST_EFFORT;
  }
  auto subscription = rcl_get_zero_initialized_subscription();
  auto publisher = rcl_get_zero_initialized_publisher();
  check(rcl_subscription_init(&subscription, &node, type, args.at(1).c_str(), &to_subscribe));
  check(rcl_publisher_init(&publisher, &node, type, args.at(2).c_str(), &to_publish));
  watch_stdin();
  unsigned long relayed = 0;
  const auto allocator = rcl_get_default_allocator();
  while (!ends) {
    if (!is_ready([&] {check(rcl_wait_set_add_subscription(&waiting, &subscription, nullptr));})) {continue;}
    // As rclcpp does, one message has one buffer.
    auto message = rmw_get_zero_initialized_serialized_message();
    check(rmw_serialized_message_init(&message, 0, &allocator));
    rmw_message_info_t info;
    if (rcl_take_serialized_message(&subscription, &message, &info, nullptr) == RCL_RET_OK) {
      check(rcl_publish_serialized_message(&publisher, &message, nullptr));
      ++relayed;
    }
    check(rmw_serialized_message_fini(&message));
  }
  say("{\"relayed\": " + std::to_string(relayed) + "}");
}

static void serve(const std::vector<std::string> & args)
{
  const auto * type = ROSIDL_GET_SRV_TYPE_SUPPORT(std_srvs, srv, Trigger);
  const auto options = rcl_service_get_default_options();
  auto service = rcl_get_zero_initialized_service();
  check(rcl_service_init(&service, &node, type, args.at(1).c_str(), &options));
  const std::string text(std::stoul(args.at(2)), 'x');
  watch_stdin();
  while (!ends) {
    if (!is_ready([&] {check(rcl_wait_set_add_service(&waiting, &service, nullptr));})) {continue;}
    rmw_request_id_t id;
    std_srvs__srv__Trigger_Request request;
    std_srvs__srv__Trigger_Request__init(&request);
    if (rcl_take_request(&service, &id, &request) != RCL_RET_OK) {continue;}
    std_srvs__srv__Trigger_Response reply;
    std_srvs__srv__Trigger_Response__init(&reply);
    reply.success = true;
    rosidl_runtime_c__String__assignn(&reply.message, text.data(), text.size());
    check(rcl_send_response(&service, &id, &reply));
    std_srvs__srv__Trigger_Response__fini(&reply);
  }
}

static void call(const std::vector<std::string> & args)
{
  const auto * type = ROSIDL_GET_SRV_TYPE_SUPPORT(std_srvs, srv, Trigger);
  const auto options = rcl_client_get_default_options();
  auto client = rcl_get_zero_initialized_client();
  check(rcl_client_init(&client, &node, type, args.at(1).c_str(), &options));
  for (bool is_there = false; !is_there; std::this_thread::sleep_for(1ms)) {
    check(rcl_service_server_is_available(&node, &client, &is_there));
  }
  std::string times;
  for (unsigned long number = 0; number < std::stoul(args.at(2)); ++number) {
    const auto start = Clock::now();
    std_srvs__srv__Trigger_Request request;
    std_srvs__srv__Trigger_Request__init(&request);
    int64_t sequence = 0;
    check(rcl_send_request(&client, &request, &sequence));
    for (bool is_answered = false; !is_answered;) {
      if (!is_ready([&] {check(rcl_wait_set_add_client(&waiting, &client, nullptr));})) {std::exit(1);}
      rmw_request_id_t id;
      std_srvs__srv__Trigger_Response reply;
      std_srvs__srv__Trigger_Response__init(&reply);
      is_answered = rcl_take_response(&client, &id, &reply) == RCL_RET_OK && id.sequence_number == sequence;
      std_srvs__srv__Trigger_Response__fini(&reply);
    }
    const std::chrono::duration<double> took = Clock::now() - start;
    times += (number ? ", " : "") + std::to_string(took.count());
  }
  say("{\"times\": [" + times + "]}");
}

int main(int argc, char ** argv)
{
  const std::vector<std::string> args(argv + 1, argv + argc);
  auto options = rcl_get_zero_initialized_init_options();
  check(rcl_init_options_init(&options, rcl_get_default_allocator()));
  check(rcl_init(0, nullptr, &options, &context));
  const auto node_options = rcl_node_get_default_options();
  const std::string name = "rcl_ends_" + std::to_string(getpid());
  check(rcl_node_init(&node, name.c_str(), "/", &context, &node_options));
  check(rcl_guard_condition_init(&leaving, &context, rcl_guard_condition_get_default_options()));
  check(rcl_wait_set_init(&waiting, 1, 1, 0, 1, 1, 0, &context, rcl_get_default_allocator()));
  const std::string role = args.at(0);
  role == "relay" ? relay(args) : role == "serve" ? serve(args) : call(args);
  // Endpoints end with the process.
  return 0;
}
