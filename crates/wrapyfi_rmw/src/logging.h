// What the middleware logs, handed to this program's log.
//
//   RCUTILS_LOG_WARN(…) ── output handler of rcutils ──────────────┐
//                                                                  ├─▶ vsnprintf ─▶ wrapyfi_log_handler
//   rmw_zenoh_cpp ── rcutils_logging_console_output_handler ───────┘
//
// rmw_zenoh_cpp calls the second one itself, past the handler that is set: the program has a function of that name, which
// the loader finds before that of librcutils.
#ifndef WRAPYFI_LOGGING_H_
#define WRAPYFI_LOGGING_H_

#include <stdbool.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

// Bytes of a message that are handed on, its zero included.
#define WRAPYFI_LOG_BYTES 1024

// Receives a message that ends with a zero, and the number of bytes that all of it has; `logger` may be NULL. It is called
// by every thread of the middleware, which may hold its locks.
typedef void (* wrapyfi_log_handler)(int severity, const char * logger, const char * text, size_t length);

// Hands on what is logged from now on. False, and nothing happens, where the program itself has set up rcutils' logging.
bool wrapyfi_log_to(wrapyfi_log_handler handler);

// Address of this program's rcutils_logging_console_output_handler. Tests ask for it.
void * wrapyfi_console(void);

#ifdef __cplusplus
}
#endif

#endif  // WRAPYFI_LOGGING_H_
