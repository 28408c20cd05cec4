% Files in the manner of the thesis's highlighting_queries.pl, analyse_semantic_map.pl and spawn_semantic_map.pl: the same
% names of predicates and the same built-in ones with the same arguments, loaded into module user.

% -- highlighting

highlight_everything_that_is(Map, Class) :-
    findall(Id, ( get_subclass_in_map(Map, Class, Individual), remove_namespace(Individual, Id) ), Ids),
    highlight_models(Ids).

highlight_device_for_action(Map, Action, Device) :-
    owl_class_properties(Action, knowrob:'deviceUsed', Device),
    highlight_everything_that_is(Map, Device).

highlight_device_for_action(Map, Action) :- highlight_device_for_action(Map, Action, _).

highlight_handle_of(Map, Individual, Handle) :-
    handle_of(Map, Individual, Handle),
    highlight(Handle).

highlight(Individual) :-
    remove_namespace(Individual, Id),
    highlight_models([Id]).

get_subclass_in_map(Map, Class, Individual) :-
    rdfs_individual_of(Individual, Class),
    map_root_object(Map, Individual).

likely_storage_place(ItemClass, StorageClass) :-
    rdfs_subclass_of(ItemClass, Super),
    owl_class_properties(StorageClass, knowrob:'typePrimaryFunction-containerFor', Super).

likely_storage_place_in_environment(Map, ItemClass, Individual) :-
    likely_storage_place(ItemClass, StorageClass),
    map_root_object(Map, Individual),
    rdf_has(Individual, rdf:type, StorageClass).

handle_of(Map, Individual, Handle) :-
    map_instance(Map),
    part(Individual, Handle),
    rdf_has(Handle, rdf:type, Class),
    rdfs_subclass_of(Class, 'http://knowrob.org/kb/knowrob.owl#Handle').

part(Whole, Part) :- direct_part(Whole, Part).
part(Whole, Part) :- direct_part(Whole, Between), part(Between, Part).

direct_part(Whole, Part) :- rdf_has(Part, knowrob:parent, Whole).
direct_part(Whole, Part) :- rdf_has(Whole, knowrob:child, Part).

% -- analysis

analyse_semantic_map(Map, Classes, Individuals, Objects, Constraints, Relations) :-
    map_instance(Map),
    findall(Each, map_root_object(Map, Each), All),
    length(All, Individuals),
    partition(is_constraint, All, Joints, Bodies),
    maplist(length, [Joints, Bodies], [Constraints, Objects]),
    setof(Class, Each^( member(Each, All), class_of(Each, Class) ), Used),
    length(Used, Classes),
    setof(Parent-Child, ( member(Parent, All), rdf_has(Parent, knowrob:child, Child) ), Pairs),
    length(Pairs, Relations).

class_of(Individual, Class) :-
    rdf_has(Individual, rdf:type, Class),
    not(rdf_equal(Class, owl:'NamedIndividual')).

is_constraint(Individual) :-
    rdf_has(Individual, rdf:type, Class),
    rdf_equal(Class, knowrob:'Constraint').

same_poses(Individual, Delta) :-
    findall(Pose, rdf_has(Individual, knowrob:pose, Pose), [One, Other|_]),
    maplist(pose_numbers, [One, Other], [Numbers, Others]),
    maplist([A, B]>>( abs(A - B) =< Delta ), Numbers, Others).

pose_numbers(Pose, Numbers) :-
    rdf_has(Pose, knowrob:translation, literal(type(xsd:string, Text))),
    split_string(Text, " ", "", Parts),
    maplist([Part, Number]>>number_string(Number, Part), Parts, Numbers).

% -- spawning

spawn_semantic_map(Map, Models, Constraints, Relations) :-
    findall(Model, spawn_models(Map, Model), Models),
    findall(Joint, spawn_constraints(Map, Joint), Constraints),
    findall([Parent, Child], spawn_relations(Map, Parent, Child), Relations).

spawn_models(Map, Id) :-
    map_root_object(Map, Object),
    rdf_has(Object, knowrob:pose, _),
    current_object_pose(Object, [_, _, [X, Y, Z], [Qx, Qy, Qz, Qw]]),
    class_of(Object, Class),
    maplist(remove_namespace, [Object, Class], [Id, Name]),
    spawn_model(Id, Name, X, Y, Z, Qx, Qy, Qz, Qw).

spawn_constraints(Map, Id) :-
    map_root_object(Map, Joint),
    is_constraint(Joint),
    rdf_has(Joint, knowrob:parent, Parent),
    rdf_has(Joint, knowrob:child, Child),
    maplist(remove_namespace, [Joint, Parent, Child], [Id, ParentId, ChildId]),
    rdf_has(Joint, knowrob:linearConstraint, Linear),
    rdf_has(Joint, knowrob:angularConstraint, Angular),
    maplist(number_of(Linear), [xMotion, yMotion, zMotion, limit], Motions),
    soft(Linear, [softConstraint, stiffness, damping], SoftLinear),
    maplist(number_of(Angular),
            [swing1Motion, swing2Motion, twistMotion, swing1Limit, swing2Limit, twistLimit], Limits),
    soft(Angular, [softSwingConstraint, swingStiffness, swingDamping], SoftSwing),
    soft(Angular, [softTwistConstraint, twistStiffness, twistDamping], SoftTwist),
    current_object_pose(Joint, Pose),
    Pose = [_, _, Position, Quaternion],
    append([[ParentId, ChildId], Position, Quaternion, Motions, SoftLinear, Limits, SoftSwing, SoftTwist], Parts),
    spawn_constraint(Parts).

number_of(Constraint, Name, Number) :-
    rdf_global_id(knowrob:Name, Property),
    rdf_has(Constraint, Property, literal(type(_, Text))),
    atom_number(Text, Number).

soft(Constraint, [Is, Stiffness, Damping], [Soft|Numbers]) :-
    rdf_global_id(knowrob:Is, Property),
    rdf_has(Constraint, Property, literal(type(xsd:boolean, Soft))),
    maplist(number_of(Constraint), [Stiffness, Damping], Numbers).

spawn_relations(Map, ParentId, ChildId) :-
    map_root_object(Map, Parent),
    rdf_has(Parent, knowrob:child, Child),
    maplist(remove_namespace, [Parent, Child], [ParentId, ChildId]),
    attach_model_to_parent(ParentId, ChildId).
