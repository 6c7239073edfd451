// Talking to the test: one JSON object a line on stdout, lines of hex on stdin.
#pragma once

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <deque>
#include <iostream>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <fastdds/rtps/common/Guid.h>

namespace rtps = eprosima::fastrtps::rtps;
using Bytes = std::vector<uint8_t>;

std::mutex out_lock;

std::string hex(const uint8_t* bytes, size_t count) {
    static const char digits[] = "0123456789abcdef";
    std::string text;
    for (size_t i = 0; i < count; ++i) {
        text += digits[bytes[i] >> 4];
        text += digits[bytes[i] & 15];
    }
    return text;
}

Bytes unhex(const std::string& text) {
    Bytes bytes;
    for (size_t i = 0; i + 1 < text.size(); i += 2) {
        bytes.push_back(static_cast<uint8_t>(std::stoi(text.substr(i, 2), nullptr, 16)));
    }
    return bytes;
}

std::string quoted(const std::string& text) {
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

/// One line: pairs of a key and a value that is JSON already.
void say(const std::string& event, const std::vector<std::pair<std::string, std::string>>& facts = {}) {
    std::string line = "{\"event\": " + quoted(event);
    for (const auto& fact : facts) {
        line += ", " + quoted(fact.first) + ": " + fact.second;
    }
    std::lock_guard<std::mutex> guard(out_lock);
    std::puts((line + "}").c_str());
    std::fflush(stdout);
}

const char* json(bool value) { return value ? "true" : "false"; }

std::string hex(const rtps::GUID_t& guid) {
    return hex(guid.guidPrefix.value, 12) + hex(guid.entityId.value, 4);
}

std::atomic<bool> leaving{false};
std::mutex lines_lock;
std::deque<std::string> lines;

/// Lines come in on a thread of their own; the end of stdin ends the program.
void watch_stdin() {
    std::signal(SIGTERM, [](int) { leaving = true; });
    std::thread([] {
        std::string line;
        while (std::getline(std::cin, line)) {
            std::lock_guard<std::mutex> guard(lines_lock);
            lines.push_back(line);
        }
        leaving = true;
    }).detach();
}

bool next_line(std::string& line) {
    std::lock_guard<std::mutex> guard(lines_lock);
    if (lines.empty()) {
        return false;
    }
    line = lines.front();
    lines.pop_front();
    return true;
}

void pause_ms(int ms) { std::this_thread::sleep_for(std::chrono::milliseconds(ms)); }
