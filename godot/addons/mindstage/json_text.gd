@tool
class_name MindstageJsonText
extends RefCounted
## Splits and joins JSON texts without changing their parts.
##
## Parsing and writing a number may change its digits. Descriptions are therefore kept as text, and only changed members
## are replaced.

const _VALUE: String = (
	'(?<value>\\{(?:[^{}"]++|"(?:[^"\\\\]++|\\\\.)*+"|(?&value))*+\\}'
	+ '|\\[(?:[^\\[\\]"]++|"(?:[^"\\\\]++|\\\\.)*+"|(?&value))*+\\]'
	+ '|"(?:[^"\\\\]++|\\\\.)*+"|[^\\s,\\[\\]{}":]++)'
)

static var _member: RegEx = RegEx.create_from_string(
	'\\G\\s*+[{,]\\s*+"(?<key>(?:[^"\\\\]++|\\\\.)*+)"\\s*+:\\s*+' + _VALUE
)
static var _element: RegEx = RegEx.create_from_string("\\G\\s*+[\\[,]\\s*+" + _VALUE)


## The members of an object as texts by key.
static func members(text: String) -> Dictionary[String, String]:
	var found: Dictionary[String, String] = {}
	for each: RegExMatch in _all(_member, text):
		found[each.get_string("key")] = each.get_string("value")
	return found


## The elements of an array as texts.
static func elements(text: String) -> PackedStringArray:
	var found: PackedStringArray = []
	for each: RegExMatch in _all(_element, text):
		found.append(each.get_string("value"))
	return found


## The object of the given member texts.
static func object(parts: Dictionary[String, String]) -> String:
	var written: PackedStringArray = []
	for key: String in parts:
		written.append('"%s":%s' % [key, parts[key]])
	return "{" + ",".join(written) + "}"


## The array of the given element texts.
static func array(parts: PackedStringArray) -> String:
	return "[" + ",".join(parts) + "]"


## The object with a member replaced, or removed if the new text is empty.
static func with_member(text: String, key: String, value: String) -> String:
	var parts: Dictionary[String, String] = members(text)
	if value.is_empty():
		parts.erase(key)
	else:
		parts[key] = value
	return object(parts)


## Parses a text; null if it is not JSON.
static func read(text: String) -> Variant:
	var json: JSON = JSON.new()
	return json.data if json.parse(text) == OK else null


## Writes a value with all digits of its numbers.
static func write(value: Variant) -> String:
	return JSON.stringify(value, "", false, true)


static func _all(pattern: RegEx, text: String) -> Array[RegExMatch]:
	var found: Array[RegExMatch] = []
	var at: int = 0
	while true:
		var next: RegExMatch = pattern.search(text, at)
		if next == null or next.get_end() == next.get_start():
			break
		found.append(next)
		at = next.get_end()
	return found
