// Talking to the test: one JSON object a line on stdout; the end of stdin means "leave".
#pragma once

#include <atomic>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <unistd.h>

inline std::string quoted(const std::string& text) {
    std::string out = "\"";
    for (unsigned char c : text) {
        if (c < 0x20 || c > 0x7e || c == '"' || c == '\\') {
            char escaped[8];
            std::snprintf(escaped, sizeof escaped, "\\u%04x", c);
            out += escaped;
        } else {
            out += static_cast<char>(c);
        }
    }
    return out + '"';
}

inline const char* json(bool value) { return value ? "true" : "false"; }

using Facts = std::vector<std::pair<std::string, std::string>>;

/// One line: pairs of a key and a value that is JSON already.
inline void say(const std::string& event, const Facts& facts = {}) {
    static std::mutex lock;
    std::string line = "{\"event\": " + quoted(event);
    for (const auto& fact : facts) {
        line += ", " + quoted(fact.first) + ": " + fact.second;
    }
    std::lock_guard<std::mutex> guard(lock);
    std::puts((line + "}").c_str());
    std::fflush(stdout);
}

inline std::atomic<bool> leaving{false};

/// Sets `leaving` at SIGTERM or when stdin closes: no peer outlives its test.
inline void watch_stdin() {
    std::signal(SIGTERM, [](int) { leaving = true; });
    std::thread([] {
        char bytes[256];
        while (read(0, bytes, sizeof bytes) > 0) {
        }
        leaving = true;
    }).detach();
}
