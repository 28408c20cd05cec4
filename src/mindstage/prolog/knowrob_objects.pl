% KnowRob's predicates about objects in semantic maps: poses, sizes, joints, spatial relations, storage places, time.
%
% The definitions are those of KnowRob's knowrob_objects, semantic_map_utils, comp_spatial and knowrob_temporal, on the
% present state of the world; docs/reference/prolog.md says where they differ.

:- module(mindstage_knowrob_objects,
          [ get_timepoint/1, get_timepoint/2,
            current_object_pose/2, object_pose_at_time/3, object_pose_at_time/4, object_detection/3, object_distance/3,
            object_dimensions/4, object_color/2, object_mesh_path/2, object_affordance/2, object_frame_name/2,
            storagePlaceFor/2, storagePlaceForBecause/3,
            map_root_objects/2, map_child_object/2, map_child_objects/2, map_object_info/1, map_object_type/2,
            map_object_label/2, map_object_dimensions/4, map_connection_type/3, map_joint_name/3,
            on_Physical/2, in_ContGeneric/2, comp_toTheLeftOf/2, comp_toTheRightOf/2, comp_toTheSideOf/2,
            comp_inFrontOf/2, comp_inCenterOf/2, comp_above_of/2, comp_below_of/2,
            holds/1, holds/2, holds/3, holds/4, occurs/1, occurs/2, occurs/3,
            full_name/3, bind/2, described_event/3, is_episode_event/1 ]).
:- use_module(questions).
:- use_module(prefixes).
:- use_module(library(apply)).
:- use_module(library(date)).
:- use_module(library(yall)).
:- use_module(library(error)).
:- use_module(library(lists)).
:- use_module(library(solution_sequences)).

% -- time ----------------------------------------------------------------------------------------------------------------

time_point_prefix('http://knowrob.org/kb/knowrob.owl#timepoint_').

% get_timepoint(-TimePoint): the present, whose state later questions about this time point refer to.
get_timepoint(TimePoint) :-
    request(time_point, Seconds),
    time_point(Seconds, TimePoint).

% get_timepoint(+Difference, -TimePoint): '+5s', '-2m' or '+1h' from the present.
get_timepoint(Difference, TimePoint) :-
    must_be(atom, Difference),
    (   sub_atom(Difference, _, 1, 0, Unit),
        unit_seconds(Unit, Factor),
        sub_atom(Difference, 0, _, 1, Text),
        ( sub_atom(Text, 0, 1, _, +) -> sub_atom(Text, 1, _, 0, Digits) ; sub_atom(Text, 0, 1, _, -), Digits = Text ),
        atom_number(Digits, Number)
    ->  true
    ;   type_error(time_difference, Difference)
    ),
    request(time_point, Now),
    Seconds is Now + Factor * Number,
    time_point(Seconds, TimePoint).

unit_seconds(s, 1).
unit_seconds(m, 60).
unit_seconds(h, 3600).

time_point(Seconds, TimePoint) :-
    time_point_prefix(Prefix),
    format(atom(TimePoint), "~w~6f", [Prefix, Seconds]).

% time_seconds(+Time, -Seconds): of a number, a time point, an interval (its beginning) or an event.
time_seconds(Time, Time) :- number(Time), !.
time_seconds([Time|_], Seconds) :- !, time_seconds(Time, Seconds).
time_seconds(Time, Seconds) :-
    expand_prefixes(Time, Iri),
    must_be(atom, Iri),
    (   sub_atom(Iri, Before, _, _, timepoint_),
        Start is Before + 10,
        sub_atom(Iri, Start, _, 0, Text),
        atom_number(Text, Seconds)
    ->  true
    ;   atom_number(Iri, Seconds)
    ->  true
    ;   request(episode_events(Iri), [event(_, _, Seconds, _, _)|_])
    ->  true
    ;   mindstage:rdf_has(Iri, knowrob:startTime, Point), Point \== Iri
    ->  stated_seconds(Point, Seconds)
    ;   type_error(time_point, Iri)
    ).

% stated_seconds(+Value, -Seconds): of a time point, or of a literal with a number or a date.
stated_seconds(literal(Literal), Seconds) :- !,
    (   literal_number(Literal, Seconds) -> true
    ;   arg(2, Literal, Text), parse_time(Text, Seconds)
    ).
stated_seconds(Point, Seconds) :- catch(time_seconds(Point, Seconds), error(type_error(time_point, _), _), fail).

% observation(+Time, -Number): the observed state at a time; unbound, the present. Fails if nothing was observed by then.
observation(Time, Number) :- var(Time), !, request(observe, Number).
observation(Time, Number) :-
    time_seconds(Time, Seconds),
    request(observe_at(Seconds), Number),
    Number \== none.

% -- poses ---------------------------------------------------------------------------------------------------------------

% located(+Number, ?Object, -Map, -Type, -Position, -Quaternion, -Size): Quaternion is [W, X, Y, Z].
located(Number, Object, Map, Type, Position, Quaternion, Size) :-
    expand_prefixes(Object, Given),
    request(located(Number, Given), Rows),
    member(located(Given, Map, Type, [Position, Quaternion], Size), Rows).

%!  current_object_pose(?Object, ?Pose) is nondet.
%
%   Pose is a list of the 16 numbers of the 4x4 matrix, row by row, as in KnowRob 1, and, as a second solution,
%   [map, Frame, [X, Y, Z], [QX, QY, QZ, QW]], as in KnowRob from 2017 on. A pose that is given as mat(Numbers),
%   pose([X, Y, Z], [QX, QY, QZ, QW]) or [X, Y, Z, QX, QY, QZ, QW], as in KnowRob of 2016, has that form.
current_object_pose(Object, Pose) :-
    request(observe, Number),
    object_pose(Number, Object, Pose).

object_pose(Number, Object, Pose) :-
    distinct(Object-Position-Quaternion, located(Number, Object, _, _, Position, Quaternion, _)),
    pose_form(Pose, Object, Position, Quaternion).

pose_form(Pose, _, Position, [W, X, Y, Z]) :- compound(Pose), other_pose_form(Pose, Position, [X, Y, Z, W], Numbers), !,
    ( Numbers == none -> true ; matrix(Position, [W, X, Y, Z], Numbers) ).
pose_form(Pose, _, Position, Quaternion) :- matrix(Position, Quaternion, Pose).
pose_form([map, Frame, Position, [X, Y, Z, W]], Object, Position, [W, X, Y, Z]) :- object_frame_name(Object, Frame).

other_pose_form(mat(Numbers), _, _, Numbers).
other_pose_form(pose(Position, Quaternion), Position, Quaternion, none).
other_pose_form(Pose, [X, Y, Z], [QX, QY, QZ, QW], none) :- is_list(Pose), Pose = [X, Y, Z, QX, QY, QZ, QW].

matrix([X, Y, Z], [Qw, Qx, Qy, Qz],
       [M00, M01, M02, X, M10, M11, M12, Y, M20, M21, M22, Z, 0.0, 0.0, 0.0, 1.0]) :-
    M00 is 1 - 2 * (Qy * Qy + Qz * Qz), M01 is 2 * (Qx * Qy - Qw * Qz), M02 is 2 * (Qx * Qz + Qw * Qy),
    M10 is 2 * (Qx * Qy + Qw * Qz), M11 is 1 - 2 * (Qx * Qx + Qz * Qz), M12 is 2 * (Qy * Qz - Qw * Qx),
    M20 is 2 * (Qx * Qz - Qw * Qy), M21 is 2 * (Qy * Qz + Qw * Qx), M22 is 1 - 2 * (Qx * Qx + Qy * Qy).

%!  object_pose_at_time(?Object, +Time, ?Pose) is nondet.
%
%   Pose has the two forms of current_object_pose/2.
object_pose_at_time(Object, Time, Pose) :-
    pose_at_time(Object, Time, Position, Quaternion),
    pose_form(Pose, Object, Position, Quaternion).

%!  object_pose_at_time(?Object, +Time, ?Position, ?Quaternion) is nondet.
%
%   Quaternion is [W, X, Y, Z].
object_pose_at_time(Object, Time, Position, Quaternion) :- pose_at_time(Object, Time, Position, Quaternion).

pose_at_time(Object, Time, Position, Quaternion) :-
    (   observation(Time, Number)
    ->  distinct(Object-Position-Quaternion, located(Number, Object, _, _, Position, Quaternion, _))
    ;   detected_pose(Object, Time, Position, Quaternion)
    ).

% Before the first observation, the perceptions that a map describes are all there is.
detected_pose(Object, Time, Position, Quaternion) :-
    time_seconds(Time, Seconds),
    distinct(Object, ( object_detection(Object, _, Some), detection_start(Some, _) )),
    findall(Start-Detection,
            ( object_detection(Object, _, Detection), detection_start(Detection, Start), Start =< Seconds ), Detections),
    max_member(_-Latest, Detections),
    once(mindstage:rdf_has(Latest, knowrob:eventOccursAt, Pose)),
    stated_pose(Pose, Position, Quaternion).

% stated_pose(+Pose, -Position, -Quaternion): of a 4x4 matrix, or of a translation and a quaternion (w, x, y, z).
stated_pose(Pose, Position, Quaternion) :-
    matrix_numbers(Pose, Numbers), !,
    matrix_pose(Numbers, Position, Quaternion).
stated_pose(Pose, Position, Quaternion) :-
    maplist(stated_numbers(Pose), [translation, quaternion], [Position, Quaternion]).

stated_numbers(Pose, Property, Numbers) :-
    mindstage:rdf_has(Pose, knowrob:Property, literal(Literal)),
    ( compound(Literal) -> arg(2, Literal, Text) ; Text = Literal ),
    split_string(Text, " ", " ", Parts),
    maplist(number_string, Numbers, Parts).

matrix_numbers(Matrix, Numbers) :-
    findall(Property, ( member(Row, [0, 1, 2, 3]), member(Column, [0, 1, 2, 3]),
                        atomic_list_concat([m, Row, Column], Property) ), Properties),
    maplist(matrix_number(Matrix), Properties, Numbers).

matrix_number(Matrix, Property, Number) :-
    once(mindstage:rdf_has(Matrix, knowrob:Property, literal(Literal))),
    literal_number(Literal, Number).

matrix_pose([M00, M01, M02, X, M10, M11, M12, Y, M20, M21, M22, Z|_], [X, Y, Z], [Qw, Qx, Qy, Qz]) :-
    Trace is M00 + M11 + M22,
    findall(Size-Which, member(Size-Which, [Trace-w, M00-x, M11-y, M22-z]), Sizes),
    max_member(_-Largest, Sizes),
    quaternion(Largest, [M00, M01, M02, M10, M11, M12, M20, M21, M22], Qw, Qx, Qy, Qz).

% S. W. Shepperd, Quaternion from rotation matrix, Journal of Guidance and Control 1, 1978: divides by the largest part.
quaternion(w, [M00, M01, M02, M10, M11, M12, M20, M21, M22], W, X, Y, Z) :-
    S is 2 * sqrt(1 + M00 + M11 + M22), W is S / 4, X is (M21 - M12) / S, Y is (M02 - M20) / S, Z is (M10 - M01) / S.
quaternion(x, [M00, M01, M02, M10, M11, M12, M20, M21, M22], W, X, Y, Z) :-
    S is 2 * sqrt(1 + M00 - M11 - M22), W is (M21 - M12) / S, X is S / 4, Y is (M01 + M10) / S, Z is (M02 + M20) / S.
quaternion(y, [M00, M01, M02, M10, M11, M12, M20, M21, M22], W, X, Y, Z) :-
    S is 2 * sqrt(1 + M11 - M00 - M22), W is (M02 - M20) / S, X is (M01 + M10) / S, Y is S / 4, Z is (M12 + M21) / S.
quaternion(z, [M00, M01, M02, M10, M11, M12, M20, M21, M22], W, X, Y, Z) :-
    S is 2 * sqrt(1 + M22 - M00 - M11), W is (M10 - M01) / S, X is (M02 + M20) / S, Y is (M12 + M21) / S, Z is S / 4.

%!  object_detection(?Object, ?Time, -Detection) is nondet.
%
%   The perceptions that a map describes; with a time, those that do not begin later.
object_detection(Object, Time, Detection) :-
    full_name(Object, individual, Iri),
    mindstage:rdf_has(Detection, knowrob:objectActedOn, Iri),
    bind(Object, Iri),
    once(mindstage:rdf_has(Detection, knowrob:eventOccursAt, _)),
    (   var(Time) -> true
    ;   time_seconds(Time, Seconds), detection_start(Detection, Start), Start =< Seconds
    ).

detection_start(Detection, Start) :- mindstage:rdf_has(Detection, knowrob:startTime, Point), stated_seconds(Point, Start).

object_distance(One, Other, Distance) :-
    request(observe, Number),
    located(Number, One, Map, _, [X1, Y1, Z1], _, _),
    located(Number, Other, Map, _, [X2, Y2, Z2], _, _),
    Distance is sqrt((X1 - X2)**2 + (Y1 - Y2)**2 + (Z1 - Z2)**2).

object_frame_name(Object, Frame) :-
    expand_prefixes(Object, Iri),
    atom(Iri),
    (   atomic_list_concat(Parts, '#', Iri), Parts = [_, _|_] -> last(Parts, Frame)
    ;   atomic_list_concat(Parts, /, Iri), last(Parts, Frame)
    ).

% -- appearance ----------------------------------------------------------------------------------------------------------

%!  object_dimensions(?Object, ?Depth, ?Width, ?Height) is nondet.
%
%   The extents along the x, y and z axes of the object [m], as numbers.
object_dimensions(Object, Depth, Width, Height) :-
    request(observe, Number),
    distinct(Object-Size, ( located(Number, Object, _, body, _, _, Size), Size \== none )),
    Size = [Depth, Width, Height].
object_dimensions(Object, Depth, Width, Height) :- dimensions_of_round(Object, Depth, Width, Height).

% What has no box but a radius: as wide as high, and 3 cm deep, like a knob in KnowRob.
dimensions_of_round(Object, 0.03, Width, Width) :-
    full_name(Object, individual, Iri),
    mindstage:rdf_has(Iri, knowrob:radius, literal(Literal)),
    bind(Object, Iri),
    literal_number(Literal, Radius),
    request(observe, Number),
    \+ ( located(Number, Object, _, body, _, _, Size), Size \== none ),
    Width is 2 * Radius.

literal_number(Literal, Number) :-
    ( compound(Literal) -> arg(2, Literal, Text) ; Text = Literal ),
    ( number(Text) -> Number = Text ; atom_number(Text, Number) ).

%!  object_color(+Object, -Color) is det.
%
%   [Red, Green, Blue, Alpha] from 0 to 1; [0.5, 0.5, 0.5, 1.0] if no color is stated.
object_color(Object, Color) :-
    full_name(Object, individual, Iri),
    stated_color(Iri, Literal),
    ( compound(Literal) -> arg(2, Literal, Text) ; Text = Literal ),
    split_string(Text, " ", " ", Parts),
    catch(maplist(number_string, Numbers, Parts), error(_, _), fail),
    ( Numbers = [_, _, _] -> append(Numbers, [1.0], Found) ; Numbers = [_, _, _, _], Found = Numbers ),
    !,
    Color = Found.
object_color(Object, Color) :-
    request(appearance(Object), appearance(Stated, _)),
    ( Stated = [_, _, _] -> append(Stated, [1.0], Color) ; Color = [0.5, 0.5, 0.5, 1.0] ).

stated_color(Object, Literal) :- mindstage:rdf_has(Object, knowrob:mainColorOfObject, literal(Literal)).
stated_color(Object, Literal) :-
    mindstage:rdf_has(Object, soma:hasColor, Color),
    mindstage:rdf_has(Color, dul:hasRegion, Region),
    mindstage:rdf_has(Region, soma:hasRGBValue, literal(Literal)).

object_mesh_path(Object, Path) :-
    (   var(Object)
    ->  request(observe, Number), distinct(Object, located(Number, Object, _, body, _, _, _))
    ;   true
    ),
    request(appearance(Object), appearance(_, Path)),
    Path \== none.

%!  object_affordance(?Object, ?Affordance) is nondet.
%
%   Affordances and dispositions that are stated for the object, then the classes that its classes are restricted to.
object_affordance(Object, Affordance) :-
    distinct(Object-Affordance, affordance(Object, Affordance)).

affordance_property('http://knowrob.org/kb/knowrob.owl#hasAffordance').
affordance_property('http://www.ease-crc.org/ont/SOMA.owl#hasAffordance').
affordance_property('http://www.ease-crc.org/ont/SOMA.owl#hasDisposition').

affordance(Object, Affordance) :-
    full_name(Object, individual, Iri),
    affordance_property(Property),
    mindstage:rdf_has(Iri, Property, Affordance),
    atom(Affordance),
    bind(Object, Iri).
affordance(Object, Class) :-
    object_class(Object, Of),
    affordance_property(Property),
    mindstage:owl_class_properties(Of, Property, Class),
    atom(Class).

object_class(Object, Class) :-
    (   var(Object) -> request(observe, Number), distinct(Object, located(Number, Object, _, _, _, _, _)) ; true ),
    map_object_type(Object, Class).

% -- storage -------------------------------------------------------------------------------------------------------------

%!  storagePlaceFor(?Place, ?Item) is nondet.
%
%   An individual that items of a class, or an individual of such a class, are stored in.
storagePlaceFor(Place, Item) :-
    distinct(Place-Item, storagePlaceForBecause(Place, Item, _)).

%!  storagePlaceForBecause(?Place, ?Item, ?Class) is nondet.
%
%   Class is the class that the storage place is for: that of the item, or an ancestor of it.
storagePlaceForBecause(Place, Item, Because) :-
    expand_prefixes(Item, Given),
    full_name(Because, class, Reason),
    full_name(Place, individual, Storage),
    (   nonvar(Given) -> item_class(Given, Class) ; true ),
    findall(storage(Class, PlaceClass, Reason), question(storage_place, [Class, PlaceClass, Reason]), Found),
    member(storage(Class, PlaceClass, Reason), Found),
    mindstage:rdfs_individual_of(Storage, PlaceClass),
    ( nonvar(Given) -> true ; Item = Class ; mindstage:rdf(Item, rdf:type, Class) ),
    bind(Place, Storage),
    bind(Because, Reason).

item_class(Item, Class) :-
    request(name_kinds(Item), Kinds),
    (   memberchk(class(Class), Kinds) -> true
    ;   memberchk(individual(Individual), Kinds) -> map_object_type(Individual, Class)
    ;   vocabulary(Item) -> fail  % owl:Thing, of which rdfs_individual_of/2 has individuals
    ;   Class = Item  % the question prints a warning with close names, and fails
    ).

% -- names ---------------------------------------------------------------------------------------------------------------

%!  full_name(?Name, +Kind, -Iri) is semidet.
%
%   The IRI of a short name of an individual, class or property; other names as they are.
full_name(Name, _, Iri) :- var(Name), !, Iri = Name.
full_name(Name, Kind, Iri) :-
    expand_prefixes(Name, Given),
    (   atom(Given), \+ sub_atom(Given, _, _, _, :)
    ->  request(name_kinds(Given), Kinds),
        Found =.. [Kind, Iri],
        (   memberchk(Found, Kinds) -> true ; existence_error(Kind, Given) )
    ;   Iri = Given
    ).

% -- maps ----------------------------------------------------------------------------------------------------------------

map_root_objects(Map, Objects) :- setof(Object, mindstage:map_root_object(Map, Object), Objects).

map_child_objects(Parent, Children) :- setof(Child, map_child_object(Parent, Child), Children).

%!  map_child_object(?Parent, ?Child) is nondet.
%
%   Parts at any depth that are no joints.
map_child_object(Parent, Child) :-
    expand_prefixes(Parent-Child, Whole-Part),
    distinct(Whole-Part, question(part_of, [_, Part, Whole])),
    \+ is_connection(Part).

is_connection(Part) :- request(observe, Number), once(located(Number, Part, _, joint, _, _, _)), !.
is_connection(Part) :- mindstage:rdfs_individual_of(Part, knowrob:'Connection-Physical'), !.

%!  map_object_info(?Info) is nondet.
%
%   [Object, Class, Pose, [Depth, Width, Height]] of everything in all maps that has a size; Pose has 16 numbers.
map_object_info([Object, Type, Pose, [Depth, Width, Height]]) :-
    request(observe, Number),
    distinct(Object-Position-Quaternion-Size,
             ( located(Number, Object, _, body, Position, Quaternion, Size), Size \== none )),
    Size = [Depth, Width, Height],
    map_object_type(Object, Type),
    matrix(Position, Quaternion, Pose).

%!  map_object_type(?Object, ?Class) is nondet.
%
%   Classes that are stated for what has a pose or is a knowrob:'SpatialThing', except those of OWL's vocabulary.
map_object_type(Object, Class) :-
    full_name(Object, individual, Iri),
    (   var(Iri)
    ->  request(observe, Number),
        distinct(Iri, located(Number, Iri, _, _, _, _, _)),
        object_type(Iri, Class)
    ;   object_type(Iri, Class),
        (   is_located(Iri) -> true ; once(mindstage:rdfs_subclass_of(Class, knowrob:'SpatialThing')) )
    ),
    bind(Object, Iri).

is_located(Iri) :- request(observe, Number), once(located(Number, Iri, _, _, _, _, _)).

object_type(Iri, Class) :-
    mindstage:rdf(Iri, rdf:type, Class),
    atom(Class),
    \+ vocabulary(Class).

vocabulary(Iri) :- sub_atom(Iri, 0, _, _, 'http://www.w3.org/').

map_object_label(Object, Label) :- mindstage:rdfs_label(Object, Label).

map_object_dimensions(Object, Width, Depth, Height) :- object_dimensions(Object, Depth, Width, Height).

%!  map_connection_type(?Parent, ?Child, ?Type) is nondet.
%
%   'HingedJoint', 'PrismaticJoint', 'Connection-Physical' for a joint that slides and turns, or 'Fixed'.
map_connection_type(Parent, Child, Type) :-
    connection(Parent, Child, _, Type).

map_joint_name(Parent, Child, Joint) :-
    connection(Parent, Child, Joint, _),
    Joint \== none.

connection(Parent, Child, Joint, Type) :-
    maplist([Given, Iri]>>full_name(Given, individual, Iri), [Parent, Child, Joint], [Holder, Moved, Name]),
    request(connections, Rows),
    member([Holder, Moved, Name, Type], Rows),
    maplist(bind, [Parent, Child, Joint], [Holder, Moved, Name]).

% bind(?Name, +Iri): a name that was given stays as it is.
bind(Name, Iri) :- ( var(Name) -> Name = Iri ; true ).

% -- spatial relations ---------------------------------------------------------------------------------------------------

on_Physical(Top, Bottom) :- related(on_Physical, _, Top, Bottom).
in_ContGeneric(Inner, Outer) :- related(in_ContGeneric, _, Inner, Outer).
comp_toTheLeftOf(Left, Right) :- related(comp_toTheLeftOf, _, Left, Right).
comp_toTheRightOf(Right, Left) :- related(comp_toTheRightOf, _, Right, Left).
comp_toTheSideOf(One, Other) :- related(comp_toTheSideOf, _, One, Other).
comp_inFrontOf(Front, Back) :- related(comp_inFrontOf, _, Front, Back).
comp_inCenterOf(Inner, Outer) :- related(comp_inCenterOf, _, Inner, Outer).
comp_above_of(Top, Bottom) :- related(comp_above_of, _, Top, Bottom).
comp_below_of(Bottom, Top) :- related(comp_below_of, _, Bottom, Top).

% related(+Relation, ?Time, ?One, ?Other): all solutions are of one observed state.
related(Relation, Time, One, Other) :-
    observation(Time, Number),
    expand_prefixes(One-Other, A-B),
    (   var(A), var(B), A \== B
    ->  request(related_pages(Number), Scenes),
        (   Scenes = [_] -> any_related(Scenes, Number, Relation, A, B)
        ;   distinct(A-B, any_related(Scenes, Number, Relation, A, B))
        )
    ;   A == B -> fail
    ;   request(spatially_related(Number, Relation, A, B), Pairs),
        member([A, B], Pairs)
    ).

% any_related(+Scenes, +Number, +Relation, -A, -B): all pairs, of some bodies with all others at a time.
any_related(Scenes, Number, Relation, A, B) :-
    nth0(Scene, Scenes, [Names, Pages]),
    functor(Names, _, Count),
    Last is Pages - 1,
    between(0, Last, Page),
    request(related_rows(Number, Relation, Scene, Page), Codes),
    member(Code, Codes),
    One is Code // Count + 1, arg(One, Names, A),
    Other is Code mod Count + 1, arg(Other, Names, B).

% Computed properties, which rdf_has/3 answers too (see semweb.pl); the same as in KnowRob's comp_spatial.owl.
:- multifile mindstage_semweb:computable/3.
:- dynamic mindstage_semweb:computable/3.

mindstage_semweb:computable('http://knowrob.org/kb/knowrob.owl#on-Physical', A, B) :- mindstage_knowrob_objects:on_Physical(A, B).
mindstage_semweb:computable('http://knowrob.org/kb/knowrob.owl#in-ContGeneric', A, B) :- mindstage_knowrob_objects:in_ContGeneric(A, B).
mindstage_semweb:computable('http://knowrob.org/kb/knowrob.owl#toTheLeftOf', A, B) :- mindstage_knowrob_objects:comp_toTheLeftOf(A, B).
mindstage_semweb:computable('http://knowrob.org/kb/knowrob.owl#toTheRightOf', A, B) :- mindstage_knowrob_objects:comp_toTheRightOf(A, B).
mindstage_semweb:computable('http://knowrob.org/kb/knowrob.owl#toTheSideOf', A, B) :- mindstage_knowrob_objects:comp_toTheSideOf(A, B).
mindstage_semweb:computable('http://knowrob.org/kb/knowrob.owl#inFrontOf-Generally', A, B) :- mindstage_knowrob_objects:comp_inFrontOf(A, B).
mindstage_semweb:computable('http://knowrob.org/kb/knowrob.owl#inCenterOf', A, B) :- mindstage_knowrob_objects:comp_inCenterOf(A, B).
mindstage_semweb:computable('http://knowrob.org/kb/knowrob.owl#above-Generally', A, B) :- mindstage_knowrob_objects:comp_above_of(A, B).
mindstage_semweb:computable('http://knowrob.org/kb/knowrob.owl#below-Generally', A, B) :- mindstage_knowrob_objects:comp_below_of(A, B).

% computed(?Property, ?Relation)
computed('http://knowrob.org/kb/knowrob.owl#on-Physical', on_Physical).
computed('http://knowrob.org/kb/knowrob.owl#in-ContGeneric', in_ContGeneric).
computed('http://knowrob.org/kb/knowrob.owl#toTheLeftOf', comp_toTheLeftOf).
computed('http://knowrob.org/kb/knowrob.owl#toTheRightOf', comp_toTheRightOf).
computed('http://knowrob.org/kb/knowrob.owl#toTheSideOf', comp_toTheSideOf).
computed('http://knowrob.org/kb/knowrob.owl#inFrontOf-Generally', comp_inFrontOf).
computed('http://knowrob.org/kb/knowrob.owl#inCenterOf', comp_inCenterOf).
computed('http://knowrob.org/kb/knowrob.owl#above-Generally', comp_above_of).
computed('http://knowrob.org/kb/knowrob.owl#below-Generally', comp_below_of).

% -- facts at a time -----------------------------------------------------------------------------------------------------

%!  holds(+Term) is nondet.
%!  holds(+Term, ?Time) is nondet.
%
%   Term is a spatial relation, such as on_Physical(Top, Bottom), or Property(Subject, Value), where Property may have a
%   prefix. An unbound time is the present.
holds(Term) :- holds(Term, _).
holds(Term, Time) :-
    must_be(callable, Term),
    (   Term = Prefix:Inner, atom(Prefix), compound(Inner), compound_name_arguments(Inner, Local, [Subject, Value])
    ->  holds(Subject, Prefix:Local, Value, Time)
    ;   compound_name_arguments(Term, Name, [Subject, Value])
    ->  (   relation(Name)
        ->  bind_time(Time),
            related(Name, Time, Subject, Value)
        ;   holds(Subject, Name, Value, Time)
        )
    ;   type_error(binary_relation, Term)
    ).

relation(Name) :- computed(_, Name), !.

%!  holds(?Subject, ?Property, ?Value) is nondet.
%!  holds(?Subject, ?Property, ?Value, ?Time) is nondet.
%
%   Computed properties at that time; stated ones hold at all times.
holds(Subject, Property, Value) :- holds(Subject, Property, Value, _).
holds(Subject, Property, Value, Time) :-
    full_name(Property, property, Iri),
    full_name(Subject, individual, Individual),
    bind_time(Time),
    (   nonvar(Iri), computed(Iri, Name)
    ->  full_name(Value, individual, Other),
        (   related(Name, Time, Individual, Other)
        ;   mindstage:rdf(Individual, Iri, Other)
        ),
        bind(Value, Other)
    ;   mindstage:rdf_has(Individual, Iri, Value)
    ),
    bind(Property, Iri),
    bind(Subject, Individual).

bind_time(Time) :- ( var(Time) -> get_timepoint(Time) ; true ).

%!  occurs(?Event) is nondet.
%!  occurs(?Event, ?Interval) is nondet.
%!  occurs(?Event, ?Interval, +Class) is nondet.
%
%   Events of episodes, and those that a map or an ontology describes with knowrob:startTime. Interval is [Begin, End] in
%   seconds, of an episode since its begin, End unbound if it had not ended or is not stated; a given time or interval
%   must be within that of the event.
occurs(Event) :- occurs(Event, _).
occurs(Event, Interval) :-
    distinct(Event-Begin-End, event_interval(Event, Begin, End)),
    within(Interval, Begin, End).
occurs(Event, Interval, Class) :-
    occurs(Event, Interval),
    (   is_episode_event(Event)
    ->  full_name(Class, class, Iri), request(event_is(Event, Iri), true)
    ;   once(mindstage:rdfs_individual_of(Event, Class))
    ).

is_episode_event(Event) :- atom(Event), sub_atom(Event, 0, _, _, 'urn:mindstage:episode:').
is_episode_event(Event) :- atom(Event), request(episode_events(Event), [_|_]).

event_interval(Event, Begin, End) :-
    expand_prefixes(Event, Given),
    request(episode_events(Given), Rows),
    member(event(Iri, _, Begin, Stop, _), Rows),
    ( Stop == none -> true ; End = Stop ),
    bind(Event, Iri).
event_interval(Event, Begin, End) :-
    \+ is_episode_event(Event),
    described_event(Event, Begin, End).

% described_event(?Event, -Begin, -End): with knowrob:startTime; End stays unbound if it is not stated.
described_event(Event, Begin, End) :-
    full_name(Event, individual, Iri),
    mindstage:rdf_has(Iri, knowrob:startTime, Start),
    stated_seconds(Start, Begin),
    (   mindstage:rdf_has(Iri, knowrob:endTime, Stop), stated_seconds(Stop, Found) -> End = Found ; true ),
    bind(Event, Iri).

within(Interval, Begin, End) :- var(Interval), !, Interval = [Begin, End].
within([First, Last], Begin, End) :- !,
    (   var(First), var(Last) -> First = Begin, Last = End
    ;   maplist(time_seconds, [First, Last], [From, To]), From >= Begin, ( var(End) -> true ; To =< End )
    ).
within(Time, Begin, End) :-
    time_seconds(Time, Seconds),
    Seconds >= Begin,
    ( var(End) -> true ; Seconds =< End ).
