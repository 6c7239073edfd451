#include "type_support.h"

#include <dlfcn.h>

#include <cstdlib>
#include <cstring>
#include <deque>
#include <exception>
#include <new>
#include <string>
#include <vector>

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>

#include <rmw/error_handling.h>
#include <rmw/rmw.h>
#include <rosidl_typesupport_fastrtps_cpp/message_type_support.h>
#include <rosidl_typesupport_fastrtps_cpp/service_type_support.h>
#include <rosidl_typesupport_introspection_cpp/message_introspection.hpp>

namespace {

using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;

// By which a middleware knows that `data` of a handle are callbacks for Fast CDR.
constexpr char FAST_CDR[] = "rosidl_typesupport_fastrtps_cpp";
// The same where they are the members of a message.
constexpr char MEMBERS[] = "rosidl_typesupport_introspection_cpp";

// What is not set below stays zero: true of the last fields of each that is known, those of Lyrical for buffers outside
// the CPU's memory among them.
static_assert(
  sizeof(message_type_support_callbacks_t) == 7 * sizeof(void *) ||
  sizeof(message_type_support_callbacks_t) == 10 * sizeof(void *),
  "message_type_support_callbacks_t of this ROS 2, with " WRAPYFI_RMW_VERSION ", has neither the 7 fields of Jazzy and "
  "Kilted nor the 10 of Lyrical: source one of these, or build without the feature rmw");

// Where the received bytes end: Cdr has it, and no function that tells (a jump beyond it makes the buffer longer). Naming a
// private member is allowed in an explicit instantiation, which hands out its pointer: a Cdr without it does not compile.
struct End {
  using type = FastBuffer::iterator Cdr::*;
  friend type pointer(End);
};
template<typename Tag, typename Tag::type Member>
struct Expose {
  friend typename Tag::type pointer(Tag) {return Member;}
};
template struct Expose<End, & Cdr::end_>;

struct Position {
  using type = FastBuffer::iterator Cdr::*;
  friend type pointer(Position);
};
template struct Expose<Position, & Cdr::offset_>;

bool serialize(const void * message, Cdr & cdr)
{
  const auto * body = static_cast<const wrapyfi_body *>(message);
  try {
    cdr.serialize_array(body->data, body->length);
    return true;
  } catch (...) {
    return false;
  }
}

bool deserialize(Cdr & cdr, void * message)
{
  auto * body = static_cast<wrapyfi_body *>(message);
  try {
    const size_t length = (cdr.*pointer(End{})) - (cdr.*pointer(Position{}));
    body->received_length = length;
    body->received_little_endian = cdr.endianness() == Cdr::LITTLE_ENDIANNESS;
    if (length > body->limit || length == 0) {
      return true;
    }
    body->received = static_cast<uint8_t *>(std::malloc(length));
    if (!body->received) {
      return false;
    }
    std::memcpy(body->received, cdr.get_current_position(), length);
    return true;
  } catch (...) {
    return false;
  }
}

uint32_t serialized_size(const void * message)
{
  return static_cast<uint32_t>(static_cast<const wrapyfi_body *>(message)->length);
}

size_t max_serialized_size(char & bounds)
{
  // Neither plain nor bounded: the middleware allocates by what a message has.
  bounds = 0;
  return 1;
}

const rosidl_service_type_support_t * as_service(
  const rosidl_service_type_support_t * handle, const char * identifier)
{
  return std::strcmp(handle->typesupport_identifier, identifier) == 0 ? handle : nullptr;
}

// The handle is the first member: a pointer to it is one to the whole.
struct Handled {
  rosidl_message_type_support_t handle{};
  rosidl_type_hash_t hash{};
};

struct Message : Handled {
  // By its members rmw_cyclonedds_cpp tells other nodes from Kilted on of what a type is made, and these compare it. No message
  // is made of them here.
  Handled introspection{};
  rosidl_typesupport_introspection_cpp::MessageMembers members{};
  std::vector<rosidl_typesupport_introspection_cpp::MessageMember> described;
  std::deque<std::string> member_names;
  message_type_support_callbacks_t callbacks{};
  std::string message_namespace;
  std::string name;
};

const rosidl_message_type_support_t * as_members(
  const rosidl_message_type_support_t * handle, const char * identifier)
{
  return std::strcmp(identifier, MEMBERS) == 0 ? handle : nullptr;
}

const rosidl_message_type_support_t * as_message(
  const rosidl_message_type_support_t * handle, const char * identifier)
{
  if (std::strcmp(identifier, FAST_CDR) == 0) {
    return handle;
  }
#if !__has_include(<rmw/localhost.h>)
  // From Kilted on Fast DDS compares the members of types: none would differ from all. Where it is told nothing, the name
  // decides.
  if (std::strcmp(rmw_get_implementation_identifier(), "rmw_fastrtps_cpp") == 0) {
    return nullptr;
  }
#endif
  const auto * whole = reinterpret_cast<const Handled *>(handle);
  return as_members(&static_cast<const Message *>(whole)->introspection.handle, identifier);
}

const rosidl_type_hash_t * message_hash(const rosidl_message_type_support_t * handle)
{
  return &reinterpret_cast<const Handled *>(handle)->hash;
}

rosidl_type_hash_t hash_of(const uint8_t * bytes)
{
  rosidl_type_hash_t hash{};
  if (bytes) {
    hash.version = 1;
    std::memcpy(hash.value, bytes, sizeof(hash.value));
  }
  return hash;
}

// Accessors of a sequence, which a member must have and nobody calls.
size_t no_size(const void *) {return 0;}
const void * no_element(const void *, size_t) {return nullptr;}
void * no_place(void *, size_t) {return nullptr;}
void no_resize(void *, size_t) {}

// Members are given away from Kilted on alone, where a middleware compares them: rmw_fastrtps_cpp of Jazzy would tell other
// nodes of them in the older form.
void describe(Message & message, const wrapyfi_member * members, size_t count)
{
#if !__has_include(<rmw/localhost.h>)
  message.described.reserve(count);
  for (size_t index = 0; index < count; ++index) {
    const wrapyfi_member & from = members[index];
    rosidl_typesupport_introspection_cpp::MessageMember member{};
    member.name_ = message.member_names.emplace_back(from.name).c_str();
    member.type_id_ = from.kind;
    member.string_upper_bound_ = from.text_bound;
    if (from.nested) {
      const auto * nested = reinterpret_cast<const Handled *>(from.nested);
      member.members_ = &static_cast<const Message *>(nested)->introspection.handle;
    }
    member.is_array_ = from.is_array || from.is_sequence;
    member.array_size_ = from.count;
    member.is_upper_bound_ = from.is_sequence && from.count != 0;
    member.size_function = no_size;
    member.get_const_function = no_element;
    member.get_function = no_place;
    member.resize_function = no_resize;
    message.described.push_back(member);
  }
  message.members.member_count_ = static_cast<uint32_t>(count);
  message.members.members_ = message.described.data();
#else
  static_cast<void>(message);
  static_cast<void>(members);
  static_cast<void>(count);
#endif
}

Message * make_message(const char * message_namespace, std::string name, const uint8_t * hash)
{
  auto * message = new Message;
  message->message_namespace = message_namespace;
  message->name = std::move(name);
  message->hash = hash_of(hash);
  message->callbacks.message_namespace_ = message->message_namespace.c_str();
  message->callbacks.message_name_ = message->name.c_str();
  message->callbacks.cdr_serialize = serialize;
  message->callbacks.cdr_deserialize = deserialize;
  message->callbacks.get_serialized_size = serialized_size;
  message->callbacks.max_serialized_size = max_serialized_size;
  message->handle.typesupport_identifier = FAST_CDR;
  message->handle.data = &message->callbacks;
  message->handle.func = as_message;
  message->handle.get_type_hash_func = message_hash;
  message->members.message_namespace_ = message->message_namespace.c_str();
  message->members.message_name_ = message->name.c_str();
  message->introspection.hash = message->hash;
  message->introspection.handle.typesupport_identifier = MEMBERS;
  message->introspection.handle.data = &message->members;
  message->introspection.handle.func = as_members;
  message->introspection.handle.get_type_hash_func = message_hash;
  return message;
}

struct Service {
  rosidl_service_type_support_t handle{};
  service_type_support_callbacks_t callbacks{};
  rosidl_type_hash_t hash{};
  std::string service_namespace;
  std::string name;
};

const rosidl_type_hash_t * service_hash(const rosidl_service_type_support_t * handle)
{
  return &reinterpret_cast<const Service *>(handle)->hash;
}

}  // namespace

extern "C" const char * wrapyfi_rmw_file()
{
  Dl_info info;
  void * place = reinterpret_cast<void *>(&rmw_get_zero_initialized_init_options);
  return dladdr(place, &info) ? info.dli_fname : nullptr;
}

extern "C" rmw_ret_t wrapyfi_leave(rmw_context_t * context)
{
  try {
    const rmw_ret_t shut = rmw_shutdown(context);
    const rmw_ret_t ended = rmw_context_fini(context);
    return shut == RMW_RET_OK ? ended : shut;
  } catch (const std::exception & thrown) {
    RMW_SET_ERROR_MSG(thrown.what());
  } catch (...) {
    RMW_SET_ERROR_MSG("an exception without words");
  }
  return RMW_RET_ERROR;
}

extern "C" bool wrapyfi_body_write(const wrapyfi_body * body, uint8_t * buffer, size_t capacity)
{
  try {
    FastBuffer fixed(reinterpret_cast<char *>(buffer), capacity);
    Cdr cdr(fixed);
    return serialize(body, cdr);
  } catch (...) {
    return false;
  }
}

extern "C" void wrapyfi_body_free(wrapyfi_body * body)
{
  std::free(body->received);
  body->received = nullptr;
}

extern "C" const rosidl_message_type_support_t * wrapyfi_message_type(
  const char * message_namespace, const char * name, const uint8_t * hash,
  const wrapyfi_member * members, size_t count)
{
  try {
    auto * message = make_message(message_namespace, name, hash);
    describe(*message, members, count);
    return &message->handle;
  } catch (...) {
    return nullptr;
  }
}

extern "C" const rosidl_service_type_support_t * wrapyfi_service_type(
  const char * service_namespace, const char * name,
  const uint8_t * hash, const uint8_t * request_hash, const uint8_t * response_hash)
{
  try {
    const std::string base(name);
    auto * service = new Service;
    service->hash = hash_of(hash);
    service->service_namespace = service_namespace;
    service->name = base;
    const auto * request = make_message(service_namespace, base + "_Request", request_hash);
    const auto * response = make_message(service_namespace, base + "_Response", response_hash);
    service->callbacks.service_namespace_ = service->service_namespace.c_str();
    service->callbacks.service_name_ = service->name.c_str();
    service->callbacks.request_members_ = &request->handle;
    service->callbacks.response_members_ = &response->handle;
    service->handle.typesupport_identifier = FAST_CDR;
    service->handle.data = &service->callbacks;
    service->handle.func = as_service;
    service->handle.request_typesupport = &request->handle;
    service->handle.response_typesupport = &response->handle;
    service->handle.get_type_hash_func = service_hash;
    return &service->handle;
  } catch (...) {
    return nullptr;
  }
}
