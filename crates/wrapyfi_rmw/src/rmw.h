// What bindgen reads of the ROS 2 that is sourced.
#include <rcutils/allocator.h>
#include <rcutils/logging.h>
#include <rcutils/strdup.h>
#include <rcutils/types/uint8_array.h>
#include <rmw/error_handling.h>
#include <rmw/event.h>
#include <rmw/events_statuses/events_statuses.h>
#include <rmw/get_node_info_and_types.h>
#include <rmw/get_topic_endpoint_info.h>
#include <rmw/get_topic_names_and_types.h>
#include <rmw/init.h>
#include <rmw/init_options.h>
#include <rmw/rmw.h>
#include <rmw/topic_endpoint_info_array.h>
#include <rcutils/types/string_array.h>
#include "logging.h"
#include "type_support.h"
