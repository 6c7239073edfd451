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
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <memory>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include "discovery.hpp"
#include "talk.hpp"
#include "types.hpp"

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
        // Who is told to leave waits for nobody: the others may be gone without a word.
        if (!leaving && (role == "publish" || role == "server")) {
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
