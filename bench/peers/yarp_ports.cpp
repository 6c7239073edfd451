// The ends of a ride over YARP's own library, as `bench/src/yarp` has them over ours.
//
//   near ══ bottles, there and back, or images one way ══▶ far
//        ◀──────── a byte for each batch of images ────────
//
//   yarp_ports far LOAD CARRIER         says {"peer": PORT}; ends with its stdin
//   yarp_ports near LOAD CARRIER PEER   obeys orders, a JSON object a line, until they end
//
// Sending blocks until the message is acknowledged where the carrier does that (`Port::write`, the fastest of
// YARP's ways to send everything), from an image that nobody copies. Requests are answered in the thread that
// reads them.

#include <yarp/os/all.h>
#include <yarp/sig/Image.h>

#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <ctime>
#include <iostream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

using Image = yarp::sig::ImageOf<yarp::sig::PixelRgb>;

namespace {

constexpr int BATCH = 100;
constexpr int WIDTH = 640;
constexpr int HEIGHT = 480;
constexpr double PATIENCE_S = 20.0;

std::uint64_t now_ns() {
    timespec time{};
    clock_gettime(CLOCK_MONOTONIC, &time);
    return static_cast<std::uint64_t>(time.tv_sec) * 1'000'000'000U + static_cast<std::uint64_t>(time.tv_nsec);
}

void require(bool holds, const char* what) {
    if (!holds) {
        throw std::runtime_error(what);
    }
}

sockaddr_in local(std::uint16_t port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(port);
    return address;
}

int without_delay(int stream) {
    require(stream >= 0, "no connection between the ends");
    int on = 1;
    setsockopt(stream, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    return stream;
}

// Socket where near is told of batches, and its number.
class Teller {
public:
    Teller() : listener_(socket(AF_INET, SOCK_STREAM, 0)) {
        auto address = local(0);
        socklen_t size = sizeof address;
        auto* any = reinterpret_cast<sockaddr*>(&address);
        require(bind(listener_, any, size) == 0 && listen(listener_, 1) == 0, "no socket to listen on");
        require(getsockname(listener_, any, &size) == 0, "a socket without a number");
        port = ntohs(address.sin_port);
    }
    int accepted() const { return without_delay(accept(listener_, nullptr, nullptr)); }

    std::uint16_t port = 0;

private:
    int listener_;
};

class Echo : public yarp::os::PortReader {
public:
    bool read(yarp::os::ConnectionReader& connection) override {
        yarp::os::Bottle request;
        if (!request.read(connection)) {
            return false;
        }
        auto* writer = connection.getWriter();
        return writer == nullptr || request.write(*writer);
    }
};

void say_ready(std::uint16_t port) {
    std::cout << "{\"peer\":" << port << "}" << std::endl;
}

[[noreturn]] void far_bottles() {
    Echo echo;
    yarp::os::RpcServer server;
    server.setReader(echo);
    require(server.open("/far/in"), "port /far/in does not open");
    say_ready(0);
    while (true) {
        pause();
    }
}

[[noreturn]] void far_images() {
    Teller teller;
    yarp::os::BufferedPort<Image> port;
    port.setStrict(true);
    require(port.open("/far/in"), "port /far/in does not open");
    say_ready(teller.port);
    const int told = teller.accepted();
    while (true) {
        for (int image = 0; image < BATCH; ++image) {
            const Image* received = port.read(true);
            require(received != nullptr, "the port was closed");
            require(received->width() == WIDTH && received->height() == HEIGHT, "an image of another size");
        }
        require(write(told, "\1", 1) == 1, "near does not listen");
    }
}

class Near {
public:
    virtual ~Near() = default;
    // Does it once; how many messages that were.
    virtual int once() = 0;
    virtual int warm() const = 0;
};

class NearBottles : public Near {
public:
    explicit NearBottles(const std::string& carrier) {
        bottle_.addString(std::string(1024, 'x'));
        require(client_.open("/near"), "port /near does not open");
        require(client_.addOutput("/far/in", carrier), "no connection to /far/in");
    }
    int once() override {
        yarp::os::Bottle reply;
        require(client_.write(bottle_, reply) && reply == bottle_, "the reply is another bottle");
        return 1;
    }
    int warm() const override { return 200; }

private:
    yarp::os::RpcClient client_;
    yarp::os::Bottle bottle_;
};

class NearImages : public Near {
public:
    NearImages(const std::string& carrier, std::uint16_t peer) : told_(without_delay(socket(AF_INET, SOCK_STREAM, 0))) {
        auto address = local(peer);
        require(connect(told_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0, "far does not listen");
        image_.setQuantum(1);
        image_.resize(WIDTH, HEIGHT);
        std::fill_n(image_.getRawImage(), image_.getRawImageSize(), 7);
        require(port_.open("/near/out"), "port /near/out does not open");
        require(port_.addOutput("/far/in", carrier), "no connection to /far/in");
    }
    int once() override {
        for (int image = 0; image < BATCH; ++image) {
            require(port_.write(image_), "an image was not written");
        }
        char byte = 0;
        require(read(told_, &byte, 1) == 1, "far has gone");
        return BATCH;
    }
    int warm() const override { return 1; }

private:
    int told_;
    yarp::os::Port port_;
    Image image_;
};

// Does it so often, one after the other; times are those of one message.
void exchange(Near& near, int count, std::uint64_t opening_ns) {
    std::vector<double> times;
    times.reserve(static_cast<std::size_t>(count));
    int messages = 0;
    const auto begin = now_ns();
    for (int done = 0; done < count; ++done) {
        const auto start = now_ns();
        const int sent = near.once();
        times.push_back(static_cast<double>(now_ns() - start) / 1e3 / sent);
        messages += sent;
    }
    const auto span = now_ns() - begin;
    std::cout << "{\"sent\":" << messages << ",\"refused\":0,\"received\":" << messages
              << ",\"duplicates\":0,\"latest_us\":0,\"awake_ns\":0,\"span_ns\":" << span
              << ",\"opening_ns\":" << opening_ns << ",\"latency_us\":[";
    for (std::size_t at = 0; at < times.size(); ++at) {
        std::cout << (at == 0 ? "" : ",") << times[at];
    }
    std::cout << "]}" << std::endl;
}

void obey(Near& near, std::uint64_t start) {
    static const std::string COUNT = "\"count\":";
    std::string order;
    while (std::getline(std::cin, order)) {
        const auto at = order.find(COUNT);
        if (at == std::string::npos) {
            exchange(near, near.warm(), now_ns() - start);
        } else {
            exchange(near, std::stoi(order.substr(at + COUNT.size())), 0);
        }
    }
}

void run(const std::vector<std::string>& words) {
    require(words.size() >= 3, "usage: yarp_ports near|far LOAD CARRIER [PEER]");
    const bool images = words[1] == "vga-rgb";
    const auto start = now_ns();
    if (words[0] == "far") {
        std::thread([] {
            while (std::cin.get() != std::char_traits<char>::eof()) {
            }
            std::_Exit(0);
        }).detach();
        images ? far_images() : far_bottles();
    }
    require(words.size() == 4, "near needs the number of far's socket");
    if (images) {
        NearImages near(words[2], static_cast<std::uint16_t>(std::stoul(words[3])));
        obey(near, start);
    } else {
        NearBottles near(words[2]);
        obey(near, start);
    }
}

} // namespace

int main(int count, char** words) {
    yarp::os::Network network;
    try {
        require(yarp::os::Network::checkNetwork(PATIENCE_S), "no name server");
        run({words + 1, words + count});
    } catch (const std::exception& error) {
        std::cerr << error.what() << std::endl;
        std::_Exit(1);
    }
    std::_Exit(0);
}
