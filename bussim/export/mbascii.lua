-- Modbus ASCII for Wireshark and tshark, which know only RTU: frames of the link type USER2 (149) of
-- "bussim export --to pcapng".
--
--   tshark -X lua_script:mbascii.lua -r trace.pcapng
--
-- or copy this file to Wireshark's folder of personal Lua plug-ins (Help > About > Folders).
-- Bit 7 of a character of seven bits marks one whose parity or stop bit was received wrongly.
-- A frame (Modbus over serial line, section 2.5.2) is ":", then station, PDU and LRC as hexadecimal
-- text, CR and LF; the bytes and the LRC add up to 0. A good frame is handed to Wireshark's own
-- dissector as the RTU frame with the same content, for the meaning of the PDU.

local mbascii = Proto("mbascii", "Modbus ASCII")

local STATUS = { [0] = "Bad", [1] = "Good" }
local f = {
  station = ProtoField.uint8("mbascii.station", "Station", base.DEC),
  func = ProtoField.uint8("mbascii.function", "Function", base.DEC),
  pdu = ProtoField.bytes("mbascii.pdu", "PDU"),
  lrc = ProtoField.uint8("mbascii.lrc", "LRC", base.HEX),
  status = ProtoField.uint8("mbascii.lrc.status", "LRC status", base.DEC, STATUS),
  wrong = ProtoField.uint8("mbascii.wrong", "Characters received wrongly", base.DEC),
}
mbascii.fields = f

local e = {
  lrc = ProtoExpert.new("mbascii.lrc.bad", "Bad LRC", expert.group.CHECKSUM, expert.severity.ERROR),
  wrong = ProtoExpert.new(
    "mbascii.wrong.expert", "Characters with wrong parity or stop bit", expert.group.MALFORMED,
    expert.severity.ERROR),
  layout = ProtoExpert.new(
    "mbascii.layout", "Not the layout of a frame", expert.group.MALFORMED, expert.severity.WARN),
}
mbascii.experts = e

local function digit(char)
  if char >= 0x30 and char <= 0x39 then
    return char - 0x30
  elseif char >= 0x41 and char <= 0x46 then
    return char - 0x37
  end
  return nil
end

local function xor(one, other)
  local value, place = 0, 1
  while one > 0 or other > 0 do
    if one % 2 ~= other % 2 then
      value = value + place
    end
    one, other, place = math.floor(one / 2), math.floor(other / 2), place * 2
  end
  return value
end

-- CRC-16/MODBUS of the first bytes, low byte first, in hexadecimal.
local function crc(bytes, count)
  local value = 0xFFFF
  for at = 1, count do
    value = xor(value, bytes[at])
    for _ = 1, 8 do
      local low = value % 2
      value = math.floor(value / 2)
      if low == 1 then
        value = xor(value, 0xA001)
      end
    end
  end
  return string.format("%02x%02x", value % 256, math.floor(value / 256))
end

-- The bytes that the text between ":" and CR LF stands for; nil if it is none. And the marked ones.
local function read(buffer)
  local chars, wrong = {}, 0
  local count = buffer:len()
  for at = 0, count - 1 do
    local value = buffer(at, 1):uint()
    if value >= 0x80 then
      wrong = wrong + 1
      value = value - 0x80
    end
    chars[at + 1] = value
  end
  if count < 9 or count % 2 == 0 or chars[1] ~= 0x3A or chars[count - 1] ~= 0x0D or chars[count] ~= 0x0A then
    return nil, wrong
  end
  local bytes = {}
  for at = 2, count - 2, 2 do
    local high, low = digit(chars[at]), digit(chars[at + 1])
    if not high or not low then
      return nil, wrong
    end
    bytes[#bytes + 1] = 16 * high + low
  end
  return bytes, wrong
end

local function text(bytes, from, to)
  local packed = {}
  for at = from, to do
    packed[#packed + 1] = string.format("%02x", bytes[at])
  end
  return table.concat(packed)
end

function mbascii.dissector(buffer, pinfo, root)
  local count = buffer:len()
  pinfo.cols.protocol = "Modbus ASCII"
  pinfo.cols.info = "not a frame"
  local tree = root:add(mbascii, buffer())
  local bytes, wrong = read(buffer)
  if wrong > 0 then
    tree:add(f.wrong, buffer(), wrong):add_proto_expert_info(e.wrong)
  end
  if not bytes then
    tree:add_proto_expert_info(e.layout)
    return count
  end
  local size, total = #bytes, 0
  for _, byte in ipairs(bytes) do
    total = total + byte
  end
  local good = total % 256 == 0
  -- Shown as a tab of its own, since each byte is two characters of the frame.
  local rtu = ByteArray.new(text(bytes, 1, size - 1) .. crc(bytes, size - 1)):tvb("As Modbus RTU")
  tree:add(f.station, buffer(1, 2), bytes[1])
  tree:add(f.func, buffer(3, 2), bytes[2])
  tree:add(f.pdu, rtu(1, size - 2))
  tree:add(f.lrc, buffer(count - 4, 2), bytes[size])
  local status = tree:add(f.status, buffer(count - 4, 2), good and 1 or 0)
  local info = string.format("station %d, function %d", bytes[1], bytes[2])
  if not good then
    status:add_proto_expert_info(e.lrc)
    pinfo.cols.info = info .. " [bad LRC]"
    return count
  end
  pinfo.cols.info = info
  -- The other dissector takes neither broadcasts nor frames below five bytes on a serial line.
  if bytes[1] > 0 and size + 1 >= 5 then
    Dissector.get("mbrtu"):call(rtu, pinfo, root)
    pinfo.cols.protocol = "Modbus ASCII"
  end
  return count
end

DissectorTable.get("wtap_encap"):add((wtap_encaps or wtap).USER2, mbascii)
