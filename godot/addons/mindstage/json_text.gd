@tool
class_name MindstageJsonText
extends RefCounted
## JSON as text: takes it apart and puts it together without touching what is not looked at.
##
## Whoever reads a number and writes it again may write other digits. So a description stays the text that it came as,
## and only what changed is replaced.

const _VALUE: String = (
	'(?<value>\\{(?:[^{}"]++|"(?:[^"\\\\]++|\\\\.)*+"|(?&value))*+\\}'
	+ '|\\[(?:[^\\[\\]"]++|"(?:[^"\\\\]++|\\\\.)*+"|(?&value))*+\\]'
	+ '|"(?:[^"\\\\]++|\\\\.)*+"|[^\\s,\\[\\]{}":]++)'
)

static var _member: RegEx = RegEx.create_from_string(
	'\\G\\s*+[{,]\\s*+"(?<key>(?:[^"\\\\]++|\\\\.)*+)"\\s*+:\\s*+' + _VALUE
)
static var _element: RegEx = RegEx.create_from_string("\\G\\s*+[\\[,]\\s*+" + _VALUE)


## The members of an object: each key with the text of its value.
static func members(text: String) -> Dictionary[String, String]:
	var found: Dictionary[String, String] = {}
	for each: RegExMatch in _all(_member, text):
		found[each.get_string("key")] = each.get_string("value")
	return found


## The texts of an array's elements.
static func elements(text: String) -> PackedStringArray:
	var found: PackedStringArray = []
	for each: RegExMatch in _all(_element, text):
		found.append(each.get_string("value"))
	return found


## An object from its members' texts.
static func object(parts: Dictionary[String, String]) -> String:
	var written: PackedStringArray = []
	for key: String in parts:
		written.append('"%s":%s' % [key, parts[key]])
	return "{" + ",".join(written) + "}"


## An array from its elements' texts.
static func array(parts: PackedStringArray) -> String:
	return "[" + ",".join(parts) + "]"


## An object in which one member is another one, or none where its new text is empty.
static func with_member(text: String, key: String, value: String) -> String:
	var parts: Dictionary[String, String] = members(text)
	if value.is_empty():
		parts.erase(key)
	else:
		parts[key] = value
	return object(parts)


## A value from text, or null where it is no JSON.
static func read(text: String) -> Variant:
	var json: JSON = JSON.new()
	return json.data if json.parse(text) == OK else null


## A value as text, with every digit of its numbers.
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
