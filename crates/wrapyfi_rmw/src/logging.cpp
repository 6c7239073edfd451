#include "logging.h"

#include <dlfcn.h>

#include <atomic>
#include <cstdarg>
#include <cstdio>

#include <rcutils/error_handling.h>
#include <rcutils/logging.h>

namespace {

std::atomic<wrapyfi_log_handler> handler{nullptr};

void hand_on(
  const rcutils_log_location_t *, int severity, const char * name, rcutils_time_point_value_t,
  const char * format, va_list * args)
{
  const auto to = handler.load();
  char text[WRAPYFI_LOG_BYTES];
  va_list copy;
  va_copy(copy, * args);
  const int length = std::vsnprintf(text, sizeof(text), format, copy);
  va_end(copy);
  if (to != nullptr && length >= 0) {
    to(severity, name, text, static_cast<size_t>(length));
  }
}

}  // namespace

extern "C" {

void rcutils_logging_console_output_handler(
  const rcutils_log_location_t * location, int severity, const char * name,
  rcutils_time_point_value_t timestamp, const char * format, va_list * args)
{
  if (handler.load() != nullptr) {
    hand_on(location, severity, name, timestamp, format, args);
    return;
  }
  static const auto of_rcutils = reinterpret_cast<rcutils_logging_output_handler_t>(
    dlsym(RTLD_NEXT, "rcutils_logging_console_output_handler"));
  if (of_rcutils != nullptr) {
    of_rcutils(location, severity, name, timestamp, format, args);
  }
}

static const auto console = &rcutils_logging_console_output_handler;
void * wrapyfi_console()
{
  return reinterpret_cast<void *>(console);
}

bool wrapyfi_log_to(wrapyfi_log_handler to)
{
  if (g_rcutils_logging_initialized) {
    return false;
  }
  if (rcutils_logging_initialize() != RCUTILS_RET_OK) {
    rcutils_reset_error();
    return false;
  }
  handler.store(to);
  rcutils_logging_set_output_handler(hand_on);
  return true;
}

}  // extern "C"
