// Types that are opaque CDR, names of DDS, and the command line.
#pragma once

#include <cstring>
#include <cstdlib>
#include <functional>
#include <map>
#include <stdexcept>
#include <string>

#include <fastdds/dds/topic/TopicDataType.hpp>

#include "talk.hpp"

using namespace eprosima::fastdds::dds;

/// CDR as it is, its four bytes of encapsulation included.
struct RawType : TopicDataType {
    explicit RawType(const std::string& name) {
        setName(name.c_str());
        m_typeSize = 16;
        m_isGetKeyDefined = false;
    }
    bool serialize(void* data, rtps::SerializedPayload_t* payload) override {
        const Bytes& bytes = *static_cast<Bytes*>(data);
        if (payload->max_size < bytes.size()) {
            return false;
        }
        payload->encapsulation = CDR_LE;
        std::memcpy(payload->data, bytes.data(), bytes.size());
        payload->length = static_cast<uint32_t>(bytes.size());
        return true;
    }
    bool deserialize(rtps::SerializedPayload_t* payload, void* data) override {
        static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
        return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
    }
    void* createData() override { return new Bytes; }
    void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
    bool getKey(void*, rtps::InstanceHandle_t*, bool) override { return false; }
};

/// `sensor_msgs/msg/Image` as DDS has it.
std::string dds_type(const std::string& name, const std::string& suffix = "") {
    const size_t one = name.find('/'), two = name.rfind('/');
    return name.substr(0, one) + "::" + name.substr(one + 1, two - one - 1) + "::dds_::" +
           name.substr(two + 1) + suffix + "_";
}

struct Options {
    std::string role, topic, type, hash, node, reply;
    long count = 0, depth = 10, receive_buffer = 0;
    bool cdr = false, best_effort = false, transient_local = false;
};

Options read_options(int argc, char** argv) {
    Options found;
    std::map<std::string, std::string*> texts{{"--topic", &found.topic}, {"--type", &found.type},
                                              {"--hash", &found.hash}, {"--node", &found.node},
                                              {"--reply", &found.reply}};
    std::map<std::string, long*> numbers{{"--count", &found.count}, {"--depth", &found.depth},
                                         {"--receive-buffer", &found.receive_buffer}};
    std::map<std::string, bool*> flags{{"--cdr", &found.cdr}, {"--best-effort", &found.best_effort},
                                       {"--transient-local", &found.transient_local}};
    found.role = argc > 1 ? argv[1] : "";
    for (int i = 2; i < argc; ++i) {
        const std::string word = argv[i];
        if (flags.count(word)) {
            *flags[word] = true;
        } else if (i + 1 < argc && texts.count(word)) {
            *texts[word] = argv[++i];
        } else if (i + 1 < argc && numbers.count(word)) {
            *numbers[word] = std::atol(argv[++i]);
        } else {
            throw std::runtime_error("unknown option " + word);
        }
    }
    return found;
}
