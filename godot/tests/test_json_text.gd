extends MindstageTestCase
## Splitting JSON texts without changing their parts.


func test_members_keep_all_digits_and_spaces() -> void:
	var text: String = '{ "a" : 1.50 , "b":[1, {"c": "}\\"]"}],"d":{"e":null} }'
	var parts: Dictionary[String, String] = MindstageJsonText.members(text)
	same(parts.keys(), ["a", "b", "d"], "keys")
	same(parts["a"], "1.50", "a number")
	same(parts["b"], '[1, {"c": "}\\"]"}]', "an array")
	same(parts["d"], '{"e":null}', "an object")


func test_elements_of_any_kind() -> void:
	var found: PackedStringArray = MindstageJsonText.elements(' [ 1.50 , "a,]b" , null, [-2e-5], {} ]')
	same(found, PackedStringArray(["1.50", '"a,]b"', "null", "[-2e-5]", "{}"]), "elements")
	same(MindstageJsonText.elements("[]").size(), 0, "none")


func test_only_the_given_member_is_replaced() -> void:
	var text: String = '{"a":1.50,"b":2}'
	same(MindstageJsonText.with_member(text, "b", "[3]"), '{"a":1.50,"b":[3]}', "another value")
	same(MindstageJsonText.with_member(text, "c", "4"), '{"a":1.50,"b":2,"c":4}', "a new one")
	same(MindstageJsonText.with_member(text, "a", ""), '{"b":2}', "without")


func test_numbers_are_written_with_all_digits() -> void:
	var number: float = 0.1 + 0.2
	var text: String = MindstageJsonText.write([number, 1.0 / 3.0, 5])
	var read: Array = JSON.parse_string(text)
	same(read[0], number, text)
	same(read[1], 1.0 / 3.0, text)
