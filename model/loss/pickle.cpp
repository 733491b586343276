#include "model/loss/pickle.h"

#include <fmt/format.h>

#include <array>
#include <bit>
#include <cstring>
#include <optional>
#include <string_view>
#include <unordered_map>

namespace ars::detail {
namespace {

constexpr std::array<std::string_view, 4> kCallables{"collections OrderedDict", "torch._utils _rebuild_tensor_v2",
                                                     "torch._utils _rebuild_tensor", "torch._utils _rebuild_parameter"};
constexpr std::size_t kMaxNodes = 1u << 22; ///< also of what all of them hold together
constexpr std::size_t kMaxKeyBytes = 256;   ///< storages' keys are short numbers
constexpr std::size_t kMaxSides = 64;       ///< of a tensor, as in PyTorch

bool isStorageGlobal(std::string_view name) {
    return (name.starts_with("torch ") || name.starts_with("torch.storage ")) && name.ends_with("Storage");
}

/// The machine of protocol 2, restricted. The stack holds values; marks are remembered by their height.
class Machine {
public:
    explicit Machine(std::span<const std::byte> bytes) : bytes_(bytes) {}

    Result<Pickle> run() {
        while (!stopped_) {
            ARS_TRY_STATUS(need(1, "an opcode"));
            opcodeAt_ = at_;
            const auto opcode = static_cast<unsigned char>(bytes_[at_++]);
            ARS_TRY_STATUS(step(opcode));
            if (result_.nodes.size() > kMaxNodes || stack_.size() > kMaxNodes) return tooMany();
        }
        result_.length = at_;
        return std::move(result_);
    }

private:
    Error tooMany() const { return bad("expected at most 4 million things"); }
    /// Before things are put into a node: what one memo holds can be asked for again with two bytes of the file.
    Status hasRoomFor(std::size_t count) {
        held_ += count;
        return held_ > kMaxNodes ? Status(tooMany()) : Status();
    }
    Error bad(std::string message) const {
        return makeError(ErrorCode::BadFile, fmt::format("byte {}", opcodeAt_), std::move(message));
    }
    Status need(std::size_t count, std::string_view what) const {
        if (bytes_.size() - at_ >= count) return {};
        return makeError(ErrorCode::BadFile, fmt::format("byte {}", at_),
                         fmt::format("expected {} bytes of {}, the pickle ends", count, what));
    }
    template <typename T>
    Result<T> number(std::string_view what) {
        ARS_TRY_STATUS(need(sizeof(T), what));
        T value;
        std::memcpy(&value, &bytes_[at_], sizeof(T));
        at_ += sizeof(T);
        return value;
    }
    Result<std::string> characters(std::size_t count) {
        ARS_TRY_STATUS(need(count, "text"));
        std::string text(reinterpret_cast<const char*>(&bytes_[0]) + at_, count);
        at_ += count;
        return text;
    }
    Result<std::string> line() {
        const std::size_t begin = at_;
        while (at_ < bytes_.size() && static_cast<char>(bytes_[at_]) != '\n' && at_ - begin < 256) ++at_;
        ARS_TRY_STATUS(need(1, "a line's end"));
        std::string text(reinterpret_cast<const char*>(&bytes_[0]) + begin, at_ - begin);
        ++at_;
        return text;
    }

    void push(PickleValue value) { stack_.push_back(value); }
    void pushInteger(std::int64_t value) { push({PickleKind::Integer, value, 0, 0}); }
    PickleNode& pushNode(PickleKind kind) {
        result_.nodes.emplace_back();
        push({kind, 0, 0, static_cast<std::uint32_t>(result_.nodes.size() - 1)});
        return result_.nodes.back();
    }
    Status pushText(Result<std::string> text) {
        if (!text) return std::move(text).error();
        pushNode(PickleKind::Text).text = std::move(*text);
        return {};
    }
    PickleNode& nodeOf(const PickleValue& value) { return result_.nodes[value.node]; }
    bool isText(const PickleValue& value) const { return value.kind == PickleKind::Text; }

    Status hold(std::size_t count) const {
        const std::size_t floor = marks_.empty() ? 0 : marks_.back();
        if (stack_.size() < floor + count) return bad("expected more on the stack than there is");
        return {};
    }
    PickleValue pop() {
        const PickleValue value = stack_.back();
        stack_.pop_back();
        return value;
    }
    Result<std::vector<PickleValue>> popToMark() {
        if (marks_.empty()) return bad("expected a mark, found none");
        std::vector<PickleValue> items(stack_.begin() + static_cast<std::ptrdiff_t>(marks_.back()), stack_.end());
        stack_.resize(marks_.back());
        marks_.pop_back();
        return items;
    }

    Status step(unsigned char opcode);
    Status stepNumber(unsigned char opcode);
    Status stepContainer(unsigned char opcode);
    Status stepMemo(unsigned char opcode);
    Status longInteger();
    Status global();
    Status reduce();
    Status rebuildTensor(const std::vector<PickleValue>& arguments);
    Status persistent();
    Status tuple(std::size_t count);
    Status append(std::vector<PickleValue> items);
    Status setItems(const std::vector<PickleValue>& items);
    Result<std::vector<std::int64_t>> integersOf(const PickleValue& value, std::string_view what);

    std::span<const std::byte> bytes_;
    std::size_t at_ = 0, opcodeAt_ = 0;
    bool stopped_ = false;
    std::size_t held_ = 0; ///< items and entries of all nodes together
    std::vector<PickleValue> stack_;
    std::vector<std::size_t> marks_;
    std::unordered_map<std::uint32_t, PickleValue> memo_;
    Pickle result_;
};

Status Machine::step(unsigned char opcode) {
    switch (opcode) {
    case 0x80: { // PROTO
        ARS_TRY(const auto protocol, number<std::uint8_t>("the protocol"));
        if (protocol > 5) return bad(fmt::format("expected pickle protocol 2 to 5, found {}", protocol));
        return {};
    }
    case 0x95:
        return number<std::uint64_t>("a frame").ok() ? Status() : bad("a frame is cut short"); // FRAME
    case '.':
        ARS_TRY_STATUS(hold(1));
        result_.top = pop();
        stopped_ = true;
        return {};
    case '(':
        marks_.push_back(stack_.size());
        return {};
    case '0': // POP
        ARS_TRY_STATUS(hold(1));
        stack_.pop_back();
        return {};
    case 'c':
        return global();
    case 'R':
        return reduce();
    case 'Q':
        return persistent();
    case 'b': // BUILD: a dictionary's attributes (_metadata), of no use here
        ARS_TRY_STATUS(hold(2));
        stack_.pop_back();
        return {};
    case 'q':
    case 'r':
    case 0x94:
    case 'h':
    case 'j':
        return stepMemo(opcode);
    case ')':
    case ']':
    case '}':
    case 't':
    case 0x85:
    case 0x86:
    case 0x87:
    case 'a':
    case 'e':
    case 's':
    case 'u':
        return stepContainer(opcode);
    default:
        return stepNumber(opcode);
    }
}

Status Machine::stepNumber(unsigned char opcode) {
    switch (opcode) {
    case 'N':
        push({});
        return {};
    case 0x88:
        push({PickleKind::Bool, 1, 0, 0});
        return {};
    case 0x89:
        push({PickleKind::Bool, 0, 0, 0});
        return {};
    case 'K': {
        ARS_TRY(const auto value, number<std::uint8_t>("a number"));
        pushInteger(value);
        return {};
    }
    case 'M': {
        ARS_TRY(const auto value, number<std::uint16_t>("a number"));
        pushInteger(value);
        return {};
    }
    case 'J': {
        ARS_TRY(const auto value, number<std::int32_t>("a number"));
        pushInteger(value);
        return {};
    }
    case 0x8a:
        return longInteger();
    case 'G': { // big endian
        ARS_TRY(const auto value, number<std::uint64_t>("a number"));
        push({PickleKind::Real, 0, std::bit_cast<double>(__builtin_bswap64(value)), 0});
        return {};
    }
    case 'U':
    case 0x8c: {
        ARS_TRY(const auto length, number<std::uint8_t>("a length"));
        return pushText(characters(length));
    }
    case 'T':
    case 'X': {
        ARS_TRY(const auto length, number<std::uint32_t>("a length"));
        return pushText(characters(length));
    }
    default:
        return makeError(
            ErrorCode::Unsupported, fmt::format("byte {}", opcodeAt_),
            fmt::format("expected a state dict, found pickle opcode 0x{:02x}, which state dicts do not use", opcode));
    }
}

Status Machine::longInteger() {
    ARS_TRY(const auto length, number<std::uint8_t>("a length"));
    ARS_TRY_STATUS(need(length, "a number"));
    std::uint64_t value = 0;
    // Longer ones are only magic numbers, which nobody computes with.
    const std::size_t used = length < 8 ? length : 8;
    std::memcpy(&value, bytes_.data() + at_, used);
    if (used > 0 && used < 8 && (static_cast<unsigned char>(bytes_[at_ + used - 1]) & 0x80))
        value |= ~std::uint64_t{0} << (8 * used);
    at_ += length;
    pushInteger(static_cast<std::int64_t>(value));
    return {};
}

Status Machine::stepMemo(unsigned char opcode) {
    if (opcode == 0x94) { // MEMOIZE
        ARS_TRY_STATUS(hold(1));
        memo_[static_cast<std::uint32_t>(memo_.size())] = stack_.back();
        return {};
    }
    std::uint32_t key = 0;
    if (opcode == 'q' || opcode == 'h') {
        ARS_TRY(const auto value, number<std::uint8_t>("a memo"));
        key = value;
    } else {
        ARS_TRY(key, number<std::uint32_t>("a memo"));
    }
    if (opcode == 'q' || opcode == 'r') {
        ARS_TRY_STATUS(hold(1));
        memo_[key] = stack_.back();
        return {};
    }
    const auto found = memo_.find(key);
    if (found == memo_.end()) return bad(fmt::format("expected memo {}, which was never made", key));
    push(found->second);
    return {};
}

Status Machine::tuple(std::size_t count) {
    ARS_TRY_STATUS(hold(count));
    ARS_TRY_STATUS(hasRoomFor(count));
    std::vector<PickleValue> items(stack_.end() - static_cast<std::ptrdiff_t>(count), stack_.end());
    stack_.resize(stack_.size() - count);
    pushNode(PickleKind::Sequence).items = std::move(items);
    return {};
}

Status Machine::append(std::vector<PickleValue> items) {
    ARS_TRY_STATUS(hold(1));
    if (stack_.back().kind != PickleKind::Sequence) return bad("expected a list to append to");
    ARS_TRY_STATUS(hasRoomFor(items.size()));
    auto& list = nodeOf(stack_.back()).items;
    list.insert(list.end(), items.begin(), items.end());
    return {};
}

Status Machine::setItems(const std::vector<PickleValue>& items) {
    ARS_TRY_STATUS(hold(1));
    if (items.size() % 2 != 0) return bad("expected keys and values in pairs");
    if (stack_.back().kind == PickleKind::Opaque) return {};
    if (stack_.back().kind != PickleKind::Dictionary) return bad("expected a dictionary to set entries of");
    ARS_TRY_STATUS(hasRoomFor(items.size() / 2));
    auto& entries = nodeOf(stack_.back()).entries;
    for (std::size_t i = 0; i < items.size(); i += 2) entries.emplace_back(items[i], items[i + 1]);
    return {};
}

Status Machine::stepContainer(unsigned char opcode) {
    switch (opcode) {
    case ')':
    case ']':
        pushNode(PickleKind::Sequence);
        return {};
    case '}':
        pushNode(PickleKind::Dictionary);
        return {};
    case 0x85:
        return tuple(1);
    case 0x86:
        return tuple(2);
    case 0x87:
        return tuple(3);
    case 't': {
        ARS_TRY(auto items, popToMark());
        ARS_TRY_STATUS(hasRoomFor(items.size()));
        pushNode(PickleKind::Sequence).items = std::move(items);
        return {};
    }
    case 'a': {
        ARS_TRY_STATUS(hold(2));
        const PickleValue item = pop();
        return append({item});
    }
    case 'e': {
        ARS_TRY(auto items, popToMark());
        return append(std::move(items));
    }
    case 's': {
        ARS_TRY_STATUS(hold(3));
        const PickleValue value = pop(), key = pop();
        return setItems({key, value});
    }
    default: {
        ARS_TRY(const auto items, popToMark());
        return setItems(items);
    }
    }
}

Status Machine::global() {
    ARS_TRY(const std::string module, line());
    ARS_TRY(const std::string name, line());
    const std::string whole = module + " " + name;
    bool known = isStorageGlobal(whole);
    for (const std::string_view callable : kCallables) known = known || whole == callable;
    if (!known) {
        return makeError(ErrorCode::Unsupported, fmt::format("byte {}", opcodeAt_),
                         fmt::format("expected a state dict of tensors alone, found \"{}.{}\"; load it in Python and "
                                     "save it with safetensors.torch.save_file",
                                     module, name));
    }
    pushNode(PickleKind::Global).text = whole;
    return {};
}

/// ("storage", type, key, device, count, ...)
Status Machine::persistent() {
    ARS_TRY_STATUS(hold(1));
    const PickleValue id = pop();
    const std::string wanted = "expected a storage as type, key, device and count";
    if (id.kind != PickleKind::Sequence) return bad(wanted);
    const std::vector<PickleValue>& items = nodeOf(id).items;
    if (items.size() < 5 || items[1].kind != PickleKind::Global || !isStorageGlobal(nodeOf(items[1]).text) ||
        !isText(items[2]) || items[4].kind != PickleKind::Integer || items[4].integer < 0) {
        return bad(wanted);
    }
    const std::string type = nodeOf(items[1]).text, key = nodeOf(items[2]).text;
    if (key.size() > kMaxKeyBytes) return bad(fmt::format("expected a storage's key of up to {} bytes", kMaxKeyBytes));
    PickleNode& storage = pushNode(PickleKind::Storage);
    storage.storageType = type.substr(type.find(' ') + 1);
    storage.text = key;
    storage.storageCount = items[4].integer;
    return {};
}

Result<std::vector<std::int64_t>> Machine::integersOf(const PickleValue& value, std::string_view what) {
    if (value.kind != PickleKind::Sequence) return bad(fmt::format("expected a tuple as {}", what));
    if (nodeOf(value).items.size() > kMaxSides) return bad(fmt::format("expected {} of up to {}", what, kMaxSides));
    std::vector<std::int64_t> result;
    for (const PickleValue& item : nodeOf(value).items) {
        if (item.kind != PickleKind::Integer || item.integer < 0)
            return bad(fmt::format("expected {} of whole numbers", what));
        result.push_back(item.integer);
    }
    return result;
}

/// (storage, offset, shape, strides, ...)
Status Machine::rebuildTensor(const std::vector<PickleValue>& arguments) {
    if (arguments.size() < 4 || arguments[0].kind != PickleKind::Storage || arguments[1].kind != PickleKind::Integer ||
        arguments[1].integer < 0) {
        return bad("expected a tensor as storage, offset, shape and strides");
    }
    ARS_TRY(auto shape, integersOf(arguments[2], "a shape"));
    ARS_TRY(auto strides, integersOf(arguments[3], "strides"));
    if (shape.size() != strides.size()) return bad("expected as many strides as sides");
    PickleNode& tensor = pushNode(PickleKind::Tensor);
    tensor.storage = arguments[0].node;
    tensor.offset = arguments[1].integer;
    tensor.shape = std::move(shape);
    tensor.strides = std::move(strides);
    return {};
}

Status Machine::reduce() {
    ARS_TRY_STATUS(hold(2));
    const PickleValue argumentValue = pop(), callable = pop();
    if (callable.kind != PickleKind::Global || argumentValue.kind != PickleKind::Sequence)
        return bad("expected a call of a known name");
    const std::string name = nodeOf(callable).text;
    const std::vector<PickleValue>& arguments = nodeOf(argumentValue).items; // a deque's elements stay in place
    if (name == "torch._utils _rebuild_tensor_v2" || name == "torch._utils _rebuild_tensor")
        return rebuildTensor(arguments);
    if (name == "torch._utils _rebuild_parameter") {
        if (arguments.empty() || arguments[0].kind != PickleKind::Tensor) return bad("expected a parameter's tensor");
        push(arguments[0]);
        return {};
    }
    if (name != "collections OrderedDict") return bad("expected a call of a known name");
    std::vector<std::pair<PickleValue, PickleValue>> entries;
    if (!arguments.empty() && arguments[0].kind == PickleKind::Sequence) {
        ARS_TRY_STATUS(hasRoomFor(nodeOf(arguments[0]).items.size()));
        for (const PickleValue& pair : nodeOf(arguments[0]).items) {
            if (pair.kind != PickleKind::Sequence || nodeOf(pair).items.size() != 2)
                return bad("expected pairs of key and value");
            entries.emplace_back(nodeOf(pair).items[0], nodeOf(pair).items[1]);
        }
    }
    pushNode(PickleKind::Dictionary).entries = std::move(entries);
    return {};
}

} // namespace

Result<Pickle> parsePickle(std::span<const std::byte> bytes) { return Machine(bytes).run(); }

} // namespace ars::detail
