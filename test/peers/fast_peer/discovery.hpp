// What others announce: participants, endpoints, and nodes in ros_discovery_info.
#pragma once

#include <stdexcept>
#include <string>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>

#include "talk.hpp"
#include "types.hpp"

std::string text_of(const std::vector<rtps::octet>& bytes) { return {bytes.begin(), bytes.end()}; }

template <class Proxy>
void say_endpoint(const char* role, const Proxy& found, bool is_gone) {
    if (is_gone) {
        say("gone", {{"role", quoted(role)}, {"guid", quoted(hex(found.guid()))}});
        return;
    }
    const std::string user_data = text_of(found.m_qos.m_userData);
    const size_t at = user_data.find("typehash=");
    const std::string hash = at == std::string::npos ? "" : user_data.substr(at + 9, user_data.find(';', at) - at - 9);
    say("endpoint", {{"role", quoted(role)},
                     {"guid", quoted(hex(found.guid()))},
                     {"topic", quoted(found.topicName().c_str())},
                     {"type", quoted(found.typeName().c_str())},
                     {"user_data", quoted(user_data)},
                     {"hash", hash.empty() ? "null" : quoted(hash)},
                     {"reliable", json(found.m_qos.m_reliability.kind == RELIABLE_RELIABILITY_QOS)},
                     {"transient_local", json(found.m_qos.m_durability.kind == TRANSIENT_LOCAL_DURABILITY_QOS)}});
}

/// Tells of everybody but the program itself.
struct Onlooker : DomainParticipantListener {
    static bool is_own(DomainParticipant* own, const rtps::GUID_t& guid) {
        return guid.guidPrefix == own->guid().guidPrefix;
    }
    void on_participant_discovery(DomainParticipant*, rtps::ParticipantDiscoveryInfo&& found) override {
        const bool is_gone = found.status == rtps::ParticipantDiscoveryInfo::REMOVED_PARTICIPANT ||
                             found.status == rtps::ParticipantDiscoveryInfo::DROPPED_PARTICIPANT;
        if (is_gone) {
            say("gone", {{"role", quoted("participant")}, {"guid", quoted(hex(found.info.m_guid))}});
        } else {
            say("participant", {{"guid", quoted(hex(found.info.m_guid))},
                                {"user_data", quoted(text_of(found.info.m_userData))}});
        }
    }
    void on_publisher_discovery(DomainParticipant* own, rtps::WriterDiscoveryInfo&& found) override {
        if (!is_own(own, found.info.guid())) {
            say_endpoint("writer", found.info, found.status == rtps::WriterDiscoveryInfo::REMOVED_WRITER);
        }
    }
    void on_subscriber_discovery(DomainParticipant* own, rtps::ReaderDiscoveryInfo&& found) override {
        if (!is_own(own, found.info.guid())) {
            say_endpoint("reader", found.info, found.status == rtps::ReaderDiscoveryInfo::REMOVED_READER);
        }
    }
};

const char INFO_TOPIC[] = "ros_discovery_info";
const char INFO_TYPE[] = "rmw_dds_common/msg/ParticipantEntitiesInfo";

/// Reads `ros_discovery_info` as ROS 2 from Iron on has it: identifiers are 16 bytes.
struct Reader {
    const Bytes& bytes;
    size_t at = 4;
    const uint8_t* take(size_t count) {
        if (count > bytes.size() - at) {
            throw std::runtime_error("ros_discovery_info is cut off");
        }
        at += count;
        return bytes.data() + at - count;
    }
    uint32_t number() {
        take((8 - at % 4) % 4);
        const uint8_t* found = take(4);
        return found[0] | found[1] << 8 | found[2] << 16 | static_cast<uint32_t>(found[3]) << 24;
    }
    std::string text() {
        const uint32_t size = number();
        const char* found = reinterpret_cast<const char*>(take(size));
        return {found, size > 0 ? size - 1 : 0};
    }
    std::string gids() {
        std::string list;
        for (uint32_t left = number(); left > 0; --left) {
            list += (list.empty() ? "" : ", ") + quoted(hex(take(16), 16));
        }
        return "[" + list + "]";
    }
};

void say_nodes(const Bytes& cdr) try {
    Reader reader{cdr};
    const std::string participant = hex(reader.take(16), 16);
    std::string nodes;
    for (uint32_t left = reader.number(); left > 0; --left) {
        std::string space = reader.text(), name = reader.text();
        if (!space.empty() && space.back() == '/') {
            space.pop_back();
        }
        const std::string readers = reader.gids(), writers = reader.gids();
        nodes += (nodes.empty() ? "" : ", ") + ("{\"name\": " + quoted(space + "/" + name)) +
                 ", \"readers\": " + readers + ", \"writers\": " + writers + "}";
    }
    say("nodes", {{"participant", quoted(participant)}, {"nodes", "[" + nodes + "]"}});
} catch (const std::exception& problem) {
    say("bad_nodes", {{"reason", quoted(problem.what())}, {"cdr", quoted(hex(cdr.data(), cdr.size()))}});
}

struct Writing {
    Bytes bytes{0, 1, 0, 0};
    void number(uint32_t value) {
        bytes.resize((bytes.size() + 3) / 4 * 4);
        for (int shift = 0; shift < 32; shift += 8) {
            bytes.push_back(static_cast<uint8_t>(value >> shift));
        }
    }
    void text(const std::string& value) {
        number(static_cast<uint32_t>(value.size() + 1));
        bytes.insert(bytes.end(), value.c_str(), value.c_str() + value.size() + 1);
    }
    void gid(const rtps::GUID_t& guid) {
        const Bytes found = unhex(hex(guid));
        bytes.insert(bytes.end(), found.begin(), found.end());
    }
};
