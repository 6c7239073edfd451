// A DDS program on Fast DDS 2 that speaks ROS 2's names, confined to 127.0.0.1.
//
//     fast_peer subscribe --topic /cam --type sensor_msgs/msg/Image --count 3 [--cdr]
//     fast_peer publish   --topic /cam --type sensor_msgs/msg/Image      messages: lines of hex on stdin
//     fast_peer client    --topic /add --type example_interfaces/srv/AddTwoInts     requests: the same
//     fast_peer server    --topic /add --type example_interfaces/srv/AddTwoInts     adds; or --reply HEX
//     fast_peer graph
//
//   stdin ─ hex ─▶ writer ═ RTPS of Fast DDS ═▶ the program under test ═▶ reader ─▶ stdout, JSON lines
//
// The domain is ROS_DOMAIN_ID. Types are opaque: payloads are CDR with its encapsulation, in hex. With
// `--node /ns/name` the program announces itself in ros_discovery_info. Lines on stdout: `ready`,
// `matched`, `message`, `sent`, `request`, `reply`, `done`; in `graph` also `participant`, `nodes`,
// `endpoint`, `gone`. It leaves at SIGTERM or when stdin closes.
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <functional>
#include <iostream>
#include <map>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

using namespace eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;
using Bytes = std::vector<uint8_t>;
using Time = std::chrono::steady_clock;

// Talking to the test -----------------------------------------------------------------------------

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

// Types and names ---------------------------------------------------------------------------------

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

// What others announce ----------------------------------------------------------------------------

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

// The program -------------------------------------------------------------------------------------

/// Readers that a writer is matched with: a server answers when the client's is among them.
struct Matches : DataWriterListener {
    std::mutex lock;
    std::set<std::string> readers;
    void on_publication_matched(DataWriter*, const PublicationMatchedStatus& status) override {
        const std::string guid = hex(rtps::iHandle2GUID(status.last_subscription_handle));
        std::lock_guard<std::mutex> guard(lock);
        if (status.current_count_change > 0) {
            readers.insert(guid);
        } else {
            readers.erase(guid);
        }
        say("matched", {{"count", std::to_string(status.current_count)}, {"with", quoted(guid)}});
    }
    bool has(const rtps::GUID_t& guid) {
        std::lock_guard<std::mutex> guard(lock);
        return readers.count(hex(guid)) > 0;
    }
};

struct Arrivals : DataReaderListener {
    void on_subscription_matched(DataReader*, const SubscriptionMatchedStatus& status) override {
        const std::string guid = hex(rtps::iHandle2GUID(status.last_publication_handle));
        say("matched", {{"count", std::to_string(status.current_count)}, {"with", quoted(guid)}});
    }
};

class Peer {
public:
    explicit Peer(const Options& options) : options(options) {
        DomainParticipantQos qos;
        qos.transport().use_builtin_transports = false;
        auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
        udp->interfaceWhiteList.push_back("127.0.0.1");
        // As rmw_fastrtps does within ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST: others are asked one by
        // one, since what is confined to lo does not hear multicast.
        udp->maxInitialPeersRange = 32;
        // In bytes; 0: what the kernel gives, as rmw_fastrtps has it.
        udp->receiveBufferSize = static_cast<uint32_t>(options.receive_buffer);
        qos.transport().user_transports.push_back(udp);
        rtps::Locator_t localhost;
        rtps::IPLocator::setIPv4(localhost, "127.0.0.1");
        qos.wire_protocol().builtin.initialPeersList.push_back(localhost);
        qos.name("fast_peer");
        const std::string enclave = "enclave=/;";
        qos.user_data().assign(enclave.begin(), enclave.end());
        const char* domain = std::getenv("ROS_DOMAIN_ID");
        participant = DomainParticipantFactory::get_instance()->create_participant(
            domain ? static_cast<uint32_t>(std::atoi(domain)) : 0, qos,
            options.role == "graph" ? &onlooker : nullptr, StatusMask::none());
        if (!participant) {
            throw std::runtime_error("Fast DDS refuses the participant");
        }
        publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
        subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
    }

    ~Peer() {
        participant->delete_contained_entities();
        DomainParticipantFactory::get_instance()->delete_participant(participant);
    }

    int run() {
        const std::string& role = options.role;
        if (role == "subscribe") {
            reader = open_reader("rt" + options.topic, dds_type(options.type));
        } else if (role == "publish") {
            writer = open_writer("rt" + options.topic, dds_type(options.type));
        } else if (role == "client") {
            writer = open_writer("rq" + options.topic + "Request", dds_type(options.type, "_Request"));
            reader = open_reader("rr" + options.topic + "Reply", dds_type(options.type, "_Response"));
        } else if (role == "server") {
            reader = open_reader("rq" + options.topic + "Request", dds_type(options.type, "_Request"));
            writer = open_writer("rr" + options.topic + "Reply", dds_type(options.type, "_Response"));
        } else if (role == "graph") {
            options.depth = 1000;
            options.transient_local = true;
            reader = open_reader(INFO_TOPIC, dds_type(INFO_TYPE));
        } else {
            throw std::runtime_error("no role " + role);
        }
        if (!options.node.empty()) {
            announce();
        }
        say("ready", {{"role", quoted(role)}, {"guid", quoted(hex(participant->guid()))}});
        long done = 0;
        while (!leaving && (options.count == 0 || done < options.count)) {
            if (role == "publish") {
                done += publish();
            } else if (role == "client") {
                done += call();
            } else {
                done += hear();
            }
        }
        if (role == "publish" || role == "server") {
            writer->wait_for_acknowledgments({30, 0});
        }
        SampleLostStatus lost;
        if (reader && reader->get_sample_lost_status(lost) == ReturnCode_t::RETCODE_OK) {
            say("done", {{"count", std::to_string(done)}, {"lost", std::to_string(lost.total_count)}});
        } else {
            say("done", {{"count", std::to_string(done)}});
        }
        while (role != "subscribe" && !leaving) {
            pause_ms(20);
        }
        return 0;
    }

private:
    TopicDescription* topic(const std::string& name, const std::string& type) {
        TypeSupport support(new RawType(type));
        support.register_type(participant);
        Topic* found = participant->create_topic(name, type, TOPIC_QOS_DEFAULT);
        if (!found) {
            throw std::runtime_error("Fast DDS refuses the topic " + name);
        }
        return found;
    }

    /// Quality of service and memory as rmw_fastrtps sets them.
    template <class Qos>
    Qos endpoint_qos() {
        Qos qos;
        qos.reliability().kind = options.best_effort ? BEST_EFFORT_RELIABILITY_QOS : RELIABLE_RELIABILITY_QOS;
        qos.durability().kind = options.transient_local ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
        qos.history().kind = KEEP_LAST_HISTORY_QOS;
        qos.history().depth = static_cast<int32_t>(options.depth);
        qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
        qos.data_sharing().off();
        if (!options.hash.empty()) {
            const std::string user_data = "typehash=" + options.hash + ";";
            qos.user_data().assign(user_data.begin(), user_data.end());
        }
        return qos;
    }

    DataReader* open_reader(const std::string& name, const std::string& type) {
        DataReader* found = subscriber->create_datareader(topic(name, type), endpoint_qos<DataReaderQos>(), &arrivals,
                                                          StatusMask::subscription_matched());
        if (!found) {
            throw std::runtime_error("Fast DDS refuses the reader of " + name);
        }
        return found;
    }

    DataWriter* open_writer(const std::string& name, const std::string& type) {
        DataWriterQos qos = endpoint_qos<DataWriterQos>();
        qos.publish_mode().kind = ASYNCHRONOUS_PUBLISH_MODE;
        DataWriter* found = publisher->create_datawriter(static_cast<Topic*>(topic(name, type)), qos, &matches,
                                                         StatusMask::publication_matched());
        if (!found) {
            throw std::runtime_error("Fast DDS refuses the writer of " + name);
        }
        return found;
    }

    /// Says in ros_discovery_info which node the endpoints belong to.
    void announce() {
        DataReader* own_reader = reader;
        DataWriter* own_writer = writer;
        const Options before = options;
        options.depth = 1;
        options.transient_local = true;
        options.best_effort = false;
        DataWriter* info = open_writer(INFO_TOPIC, dds_type(INFO_TYPE));
        options = before;
        const size_t slash = options.node.rfind('/');
        Writing cdr;
        cdr.gid(participant->guid());
        cdr.number(1);
        cdr.text(slash == 0 ? "/" : options.node.substr(0, slash));
        cdr.text(options.node.substr(slash + 1));
        cdr.number(own_reader ? 1 : 0);
        if (own_reader) {
            cdr.gid(own_reader->guid());
        }
        cdr.number(own_writer ? 1 : 0);
        if (own_writer) {
            cdr.gid(own_writer->guid());
        }
        info->write(&cdr.bytes);
    }

    /// Takes one message, waiting a little for it.
    bool take(Bytes& bytes, SampleInfo& info) {
        return reader->wait_for_unread_message({0, 20'000'000}) &&
               reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK && info.valid_data;
    }

    long publish() {
        std::string line;
        if (!next_line(line)) {
            pause_ms(2);
            return 0;
        }
        Bytes bytes = unhex(line);
        const bool is_sent = writer->write(&bytes);
        say("sent", {{"bytes", std::to_string(bytes.size())}, {"ok", json(is_sent)}});
        return 1;
    }

    /// A request as rmw_fastrtps writes it: named by the reader that waits for the reply.
    long call() {
        std::string line;
        if (next_line(line)) {
            rtps::WriteParams params;
            rtps::SampleIdentity identity;
            identity.writer_guid(reader->guid());
            params.related_sample_identity(identity);
            Bytes bytes = unhex(line);
            const bool is_sent = writer->write(&bytes, params);
            const auto number = params.sample_identity().sequence_number().to64long();
            say("sent", {{"number", std::to_string(number)}, {"ok", json(is_sent)}});
        }
        Bytes bytes;
        SampleInfo info;
        if (!take(bytes, info)) {
            return 0;
        }
        const rtps::SampleIdentity& related = info.related_sample_identity;
        const bool is_mine = related.writer_guid() == reader->guid() || related.writer_guid() == writer->guid();
        say("reply", {{"number", std::to_string(related.sequence_number().to64long())},
                      {"mine", json(is_mine)},
                      {"cdr", quoted(hex(bytes.data(), bytes.size()))}});
        return is_mine ? 1 : 0;
    }

    long hear() {
        Bytes bytes;
        SampleInfo info;
        if (!take(bytes, info)) {
            return 0;
        }
        if (options.role == "graph") {
            say_nodes(bytes);
        } else if (options.role == "server") {
            answer(bytes, info);
        } else {
            const size_t shown = options.cdr ? bytes.size() : std::min<size_t>(bytes.size(), 16);
            say("message", {{"bytes", std::to_string(bytes.size())},
                            {"from", quoted(hex(info.sample_identity.writer_guid()))},
                            {"number", std::to_string(info.sample_identity.sequence_number().to64long())},
                            {options.cdr ? "cdr" : "head", quoted(hex(bytes.data(), shown))}});
        }
        return 1;
    }

    /// The sum of two numbers, or what the command line says; under the identity that the request has.
    void answer(const Bytes& request, const SampleInfo& info) {
        rtps::SampleIdentity identity = info.sample_identity;
        const rtps::GUID_t asked_by = info.related_sample_identity.writer_guid();
        const bool is_named = asked_by != rtps::GUID_t::unknown();
        if (is_named) {
            identity.writer_guid(asked_by);
            while (!leaving && !matches.has(asked_by)) {
                pause_ms(2);
            }
        }
        say("request", {{"named", json(is_named)}, {"cdr", quoted(hex(request.data(), request.size()))}});
        Bytes reply = unhex(options.reply);
        if (reply.empty() && request.size() >= 20) {
            int64_t a, b;
            std::memcpy(&a, request.data() + 4, 8);
            std::memcpy(&b, request.data() + 12, 8);
            const int64_t sum = a + b;
            reply = {0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
            std::memcpy(reply.data() + 4, &sum, 8);
        }
        rtps::WriteParams params;
        params.related_sample_identity(identity);
        writer->write(&reply, params);
    }

    Options options;
    Onlooker onlooker;
    Matches matches;
    Arrivals arrivals;
    DomainParticipant* participant = nullptr;
    Publisher* publisher = nullptr;
    Subscriber* subscriber = nullptr;
    DataReader* reader = nullptr;
    DataWriter* writer = nullptr;
};

int main(int argc, char** argv) try {
    Peer peer(read_options(argc, argv));
    watch_stdin();
    return peer.run();
} catch (const std::exception& problem) {
    std::cerr << "fast_peer: " << problem.what() << '\n';
    return 2;
}
