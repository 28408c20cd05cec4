@tool
class_name MindstagePublisher
extends RefCounted
## A stage's state as messages that other programs of ROS understand.

const WORLD: String = "map"


## Where all bodies are, as the transforms of tf2_msgs/TFMessage.
static func transforms(stage: MindstageStage) -> Array:
	var rows: PackedFloat64Array = stage.rows()
	var time_s: float = stage.clock.time_s()
	var stamp: Dictionary = {"secs": int(time_s), "nsecs": int(fposmod(time_s, 1.0) * 1e9)}
	var found: Array = []
	for id: String in stage.inventory.bodies:
		var at: int = stage.inventory.bodies[id].row * MindstageFrames.ROW
		(
			found
			. append(
				{
					"header": {"seq": 0, "stamp": stamp, "frame_id": WORLD},
					"child_frame_id": id,
					"transform":
					{
						"translation": {"x": rows[at], "y": rows[at + 1], "z": rows[at + 2]},
						"rotation": {"x": rows[at + 4], "y": rows[at + 5], "z": rows[at + 6], "w": rows[at + 3]},
					},
				}
			)
		)
	return found
