-- N:N link for Wireshark and tshark: frames of the link type USER1 (148) of "bussim export --to pcapng".
--
--   tshark -X lua_script:nn.lua -r trace.pcapng -Y 'nn.kind == "poll" && nn.station == 2'
--
-- or copy this file to Wireshark's folder of personal Lua plug-ins (Help > About > Folders).
-- Bit 7 of a character (they have seven) marks one whose parity or stop bit was received wrongly.
-- The layout is that of bussim's frames (an assumption, see bussim/engines/nn/frames.py):
--   data        STX station counter data... ETX sum sum
--   poll        ENQ station counter sum sum
--   parameters  SOH "F" counter slaves mode retries timeout ETX sum sum
-- Station and counter are one hexadecimal digit, all else two a byte; the data are the M block, low
-- byte first, and the D words, high byte first. The sum is the low byte of the sum of all characters
-- after the header up to ETX (in a poll: up to the counter).

local SOH, STX, ETX, ENQ = 0x01, 0x02, 0x03, 0x05
local KINDS = { [STX] = "data", [ENQ] = "poll", [SOH] = "parameters" }

-- M points and D words by mode (D8178), by the bytes of the block.
local MODES = {
  [8] = { mode = 0, points = 0 },
  [12] = { mode = 1, points = 32 },
  [24] = { mode = 2, points = 64 },
  [40] = { mode = 3, points = 64 },
  [72] = { mode = 4, points = 64 },
}

local nn = Proto("nn", "N:N link")

local STATUS = { [0] = "Bad", [1] = "Good" }
local f = {
  kind = ProtoField.string("nn.kind", "Kind"),
  station = ProtoField.uint8("nn.station", "Station", base.DEC),
  counter = ProtoField.uint8("nn.counter", "Communication counter", base.DEC),
  mode = ProtoField.uint8("nn.mode", "Refresh mode (D8178)", base.DEC),
  slaves = ProtoField.uint8("nn.slaves", "Slaves (D8177)", base.DEC),
  retries = ProtoField.uint8("nn.retries", "Retries (D8179)", base.DEC),
  timeout = ProtoField.uint8("nn.timeout", "Timeout (D8180), x 10 ms", base.DEC),
  data = ProtoField.bytes("nn.data", "Data"),
  m = ProtoField.bytes("nn.m", "M block"),
  on = ProtoField.uint16("nn.m.on", "M point that is on", base.DEC),
  d = ProtoField.uint16("nn.d", "D word", base.DEC),
  sum = ProtoField.uint8("nn.sum", "Sum", base.HEX),
  status = ProtoField.uint8("nn.sum.status", "Sum status", base.DEC, STATUS),
  wrong = ProtoField.uint8("nn.wrong", "Characters received wrongly", base.DEC),
}
nn.fields = f

local e = {
  sum = ProtoExpert.new("nn.sum.bad", "Bad sum", expert.group.CHECKSUM, expert.severity.ERROR),
  wrong = ProtoExpert.new(
    "nn.wrong.expert", "Characters with wrong parity or stop bit", expert.group.MALFORMED, expert.severity.ERROR),
  layout = ProtoExpert.new("nn.layout", "Not the layout of a frame", expert.group.MALFORMED, expert.severity.WARN),
}
nn.experts = e

nn.prefs.spacing = Pref.uint("D words from station to station", 32, "32 on a PW10, 10 on an FX2N")

local function number(chars, from, to)
  local value = 0
  for at = from, to do
    local char = chars[at]
    local digit
    if char and char >= 0x30 and char <= 0x39 then
      digit = char - 0x30
    elseif char and char >= 0x41 and char <= 0x46 then
      digit = char - 0x37
    else
      return nil
    end
    value = value * 16 + digit
  end
  return value
end

-- The characters without their marks, from 1; and how many are marked.
local function read(buffer)
  local chars, wrong = {}, 0
  for at = 0, buffer:len() - 1 do
    local value = buffer(at, 1):uint()
    if value >= 0x80 then
      wrong = wrong + 1
      value = value - 0x80
    end
    chars[at + 1] = value
  end
  return chars, wrong
end

local function add_sum(tree, buffer, chars, count)
  local status, total = 0, 0
  for at = 2, count - 2 do
    total = total + chars[at]
  end
  local found = number(chars, count - 1, count)
  if found then
    tree:add(f.sum, buffer(count - 2, 2), found)
    status = (found == total % 256) and 1 or 0
  end
  local item = tree:add(f.status, buffer(count - 2, 2), status)
  if status == 0 then
    item:add_proto_expert_info(e.sum)
  end
  return status
end

-- The block is shown as a tab of its own, since each of its bytes is two characters of the frame.
local function add_data(tree, buffer, chars, station, first, last)
  local packed = {}
  for at = first, last - 1, 2 do
    local value = number(chars, at, at + 1)
    if not value then
      return false
    end
    packed[#packed + 1] = string.format("%02x", value)
  end
  local mode = MODES[#packed]
  if (last - first + 1) % 2 == 1 or not mode then
    return false
  end
  local block = ByteArray.new(table.concat(packed)):tvb("Block of station " .. station)
  tree:add(f.mode, buffer(first - 1, last - first + 1), mode.mode):set_generated()
  tree:add(f.data, block())
  local size = mode.points / 8
  if size > 0 then
    local branch = tree:add(f.m, block(0, size))
    for at = 0, size - 1 do
      local rest = block(at, 1):uint()
      for bit = 0, 7 do
        if rest % 2 == 1 then
          branch:add(f.on, block(at, 1), 1000 + 64 * station + 8 * at + bit)
        end
        rest = math.floor(rest / 2)
      end
    end
  end
  local word = nn.prefs.spacing * station
  for at = size, #packed - 1, 2 do
    tree:add(f.d, block(at, 2)):prepend_text(string.format("D%d: ", word))
    word = word + 1
  end
  return true
end

local function add_settings(tree, buffer, chars)
  local at = 4
  for _, field in ipairs({ f.slaves, f.mode, f.retries, f.timeout }) do
    local value = number(chars, at, at + 1)
    if not value then
      return false
    end
    tree:add(field, buffer(at - 1, 2), value)
    at = at + 2
  end
  return true
end

function nn.dissector(buffer, pinfo, root)
  local count = buffer:len()
  pinfo.cols.protocol = "N:N"
  local tree = root:add(nn, buffer())
  local chars, wrong = read(buffer)
  local kind = count > 0 and buffer(0, 1):uint() < 0x80 and KINDS[chars[1]] or "unknown"
  tree:add(f.kind, buffer(0, math.min(count, 1)), kind)
  local info = kind
  local sound = kind ~= "unknown"
  local station, counter
  if kind == "parameters" then
    station = 0 -- the master's; where another frame has its station, this one has an F
    sound = chars[2] == 0x46
  elseif sound then
    station = number(chars, 2, 2)
  end
  counter = sound and number(chars, 3, 3) or nil
  if station then
    tree:add(f.station, buffer(1, math.min(count - 1, 1)), station)
    info = info .. " station " .. station
  end
  if counter then
    tree:add(f.counter, buffer(2, 1), counter)
    info = info .. " counter " .. counter
  end
  sound = sound and station ~= nil and counter ~= nil
  if sound and kind == "data" then
    sound = count >= 6 and chars[count - 2] == ETX and add_data(tree, buffer, chars, station, 4, count - 3)
  elseif sound and kind == "parameters" then
    sound = count == 14 and chars[12] == ETX and add_settings(tree, buffer, chars)
  elseif sound then
    sound = count == 5
  end
  if count >= 5 and add_sum(tree, buffer, chars, count) == 0 then
    info = info .. " [bad sum]"
  end
  if wrong > 0 then
    tree:add(f.wrong, buffer(), wrong):add_proto_expert_info(e.wrong)
    info = info .. " [" .. wrong .. " characters received wrongly]"
  end
  if not sound then
    tree:add_proto_expert_info(e.layout)
  end
  pinfo.cols.info = info
  return count
end

DissectorTable.get("wtap_encap"):add((wtap_encaps or wtap).USER1, nn)
