// Type supports made at run time: a message is its serialised body.
//
//   wrapyfi_body ── cdr_serialize ──▶ eprosima::fastcdr::Cdr of the middleware
//                ◀─ cdr_deserialize ──
//
// rmw_fastrtps_cpp and rmw_zenoh_cpp call these functions for the requests and replies of services,
// and ask for names and hashes wherever an endpoint is created. No function here throws.
#ifndef WRAPYFI_TYPE_SUPPORT_H_
#define WRAPYFI_TYPE_SUPPORT_H_

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <rmw/init.h>
#include <rmw/types.h>
#include <rosidl_runtime_c/message_type_support_struct.h>
#include <rosidl_runtime_c/service_type_support_struct.h>

#ifdef __cplusplus
extern "C" {
#endif

// A message as the middleware is given it and gives it back: the bytes behind the encapsulation header.
typedef struct wrapyfi_body {
  // To be sent.
  const uint8_t * data;
  size_t length;
  // Received: allocated by malloc, to be freed by wrapyfi_body_free.
  uint8_t * received;
  size_t received_length;
  bool received_little_endian;
  // Longest body that is received: a longer one is not copied, its length is in received_length.
  size_t limit;
} wrapyfi_body;

void wrapyfi_body_free(wrapyfi_body * body);

// Serialises a body as a middleware does whose buffer has `capacity` bytes. False where it does not fit: Fast CDR
// throws there, and nothing of it may leave. Tests call it.
bool wrapyfi_body_write(const wrapyfi_body * body, uint8_t * buffer, size_t capacity);

// A member of a message, for middlewares that tell each other of what a type is made.
typedef struct wrapyfi_member {
  const char * name;
  // Number of its kind in rosidl_typesupport_introspection_c.
  uint8_t kind;
  // Longest text, or 0.
  size_t text_bound;
  // Type support of a nested message, or NULL.
  const rosidl_message_type_support_t * nested;
  // An array of `count` elements, or a sequence, of at most `count` where that is not 0.
  bool is_array;
  bool is_sequence;
  size_t count;
} wrapyfi_member;

// Type support of a message, for instance ("std_msgs::msg", "String"). `hash` is of version 1, or NULL. Without members
// where these are not known.
// NULL where there is no memory. It lives as long as the process.
const rosidl_message_type_support_t * wrapyfi_message_type(
  const char * message_namespace, const char * name, const uint8_t * hash,
  const wrapyfi_member * members, size_t count);

// Type support of a service, for instance ("example_interfaces::srv", "AddTwoInts"). Zenoh compares `hash`, DDS those of
// the request and the response.
const rosidl_service_type_support_t * wrapyfi_service_type(
  const char * service_namespace, const char * name,
  const uint8_t * hash, const uint8_t * request_hash, const uint8_t * response_hash);

// File of the librmw that is loaded, which tells of which ROS 2 it is. NULL where the loader does not know.
const char * wrapyfi_rmw_file(void);

// rmw_shutdown and rmw_context_fini. Closing a session of Zenoh throws where a thread does not end in time.
rmw_ret_t wrapyfi_leave(rmw_context_t * context);

#ifdef __cplusplus
}
#endif

#endif  // WRAPYFI_TYPE_SUPPORT_H_
