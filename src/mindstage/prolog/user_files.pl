% Loading files of KnowRob users: their libraries and ROS packages.
%
% A library that such a file names is, in this order: one that Mindstage has predicates for (nothing is loaded, they are
% there), one of SWI-Prolog, a file of the user's packages, or missing. A missing library is a warning with the reason; the
% rest of the file is loaded, and a goal that calls one of its predicates throws the error of an unknown procedure.

:- module(mindstage_user_files,
          [ register_ros_package/1, register_ros_package/2, use_ros_module/2, use_directory/1, rospack_package_path/2, ros_package_path/2,
            missing_library/2 ]).
:- use_module(questions).
:- use_module(library(apply)).
:- use_module(library(error)).
:- use_module(library(lists)).
:- use_module(library(prolog_wrap)).
:- use_module(library(semweb/rdf_prefixes), []).

:- dynamic package_folder/2, missing_library/2, warned_package/1, warned_prefix/1.
:- dynamic user:file_search_path/2, user:prolog_load_file/2, user:library_directory/1.
:- multifile user:file_search_path/2, user:prolog_load_file/2, user:library_directory/1.

% Operators of libraries that KnowRob's files use without loading them: of rdf_db, and @true of XPCE and JPL.
:- op(1150, fx, user:rdf_meta).
:- op(100, fx, user:(@)).
% Rules of KnowRob 2: Head ?> Body is asked, Head +> Body is told, Head ?+> Body is both.
:- op(1150, xfx, user:(?>)).
:- op(1150, xfx, user:(+>)).
:- op(1150, xfx, user:(?+>)).

% -- libraries ---------------------------------------------------------------------------------------------------------

% own_library(?Name): libraries whose predicates are those of Mindstage. Within SWI-Prolog's own libraries none is replaced.
own_library('semweb/rdf_db').
own_library('semweb/rdfs').
own_library('semweb/owl').
own_library('semweb/owl_parser').
own_library('semweb/rdfs_computable').
own_library('semweb/owl_computable').
own_library('semweb/rdf_edit').
own_library('semweb/rdf_portray').
own_library(rdf_db).
own_library(rdfs).
own_library(owl).
own_library(owl_parser).
own_library(rdfs_computable).
own_library(owl_computable).
own_library(knowrob_owl).
own_library(rosprolog).
own_library('knowrob/knowrob').
own_library('knowrob/rdfs').
own_library('knowrob/owl').
own_library('knowrob/owl_parser').
own_library('knowrob/computable').
own_library('thea/owl_parser').
own_library('thea2/owl2_model').

% foreign_library(?Name, -Needs): libraries that need something outside of Prolog.
foreign_library(jpl, "Java (the package swi-prolog-java)").
foreign_library(odbc, "an ODBC database (the package swi-prolog-odbc)").
foreign_library(Name, "a MongoDB server and its Java client") :- contains(Name, mongo).
foreign_library(Name, "Java (its predicates call jpl)") :- contains(Name, jpl), Name \== jpl.
foreign_library(Name, "ROS nodes (tf)") :- member(Part, [tf_prolog, transforms, tf_]), contains(Name, Part).
foreign_library(Name, "ROS nodes") :- member(Part, [roscpp, rosprolog, ros_, 'ros/', 'comm/']), contains(Name, Part).
foreign_library(Name, "the Java canvas or marker publisher of KnowRob") :- member(Part, [mod_vis, marker_vis]), contains(Name, Part).

contains(Name, Part) :- once(sub_atom(Name, _, _, _, Part)).

user:prolog_load_file(Module:Spec, _) :-
    nonvar(Spec),
    Spec = library(_),
    mindstage_user_files:loads_elsewhere(Module, Spec).

% loads_elsewhere(+Module, +Spec): handles a library that SWI-Prolog does not have, or that is replaced.
loads_elsewhere(Module, library(Spec)) :-
    library_name(Spec, Name),
    prolog_load_context(source, Source),
    \+ of_swi_prolog(Source),
    (   own_library(Name) -> true
    ;   absolute_file_name(library(Name), _, [file_type(prolog), access(read), file_errors(fail)]) -> fail
    ;   package_file(Source, Name, File)
    ->  Module:use_module(File)
    ;   of_knowrob(Source, Name),
        report_missing(Source, Name)
    ).

% library_name(+Spec, -Name): without the extension; semweb/rdf_db and 'semweb/rdf_db.pl' are the same library.
library_name(Spec, Name) :-
    path_atom(Spec, Atom),
    ( atom_concat(Name, '.pl', Atom) -> true ; Name = Atom ).

path_atom(Spec, Spec) :- atom(Spec), !.
path_atom(Parent/Child, Atom) :-
    path_atom(Parent, First),
    path_atom(Child, Second),
    atomic_list_concat([First, Second], /, Atom).

of_swi_prolog(Source) :- current_prolog_flag(home, Home), sub_atom(Source, 0, _, _, Home).

% of_knowrob(+Source, +Name): the file is in a ROS package, or the library is one of KnowRob.
of_knowrob(Source, _) :- prolog_folder(Source, _), !.
of_knowrob(Source, _) :- registered_by(Source), !.
of_knowrob(_, Name) :-
    (   foreign_library(Name, _)
    ;   member(Part, [knowrob, comp_, mod_, 'semweb/', thea, srdl, ias_, cram, ros]), contains(Name, Part)
    ;   member(Folder, ['model/', 'lang/', 'db/', 'utility/', 'reasoning/', 'comm/', 'query/']),  % of KnowRob 2
        sub_atom(Name, 0, _, _, Folder)
    ), !.

registered_by(Source) :- package_folder(_, by(Source)).

report_missing(Source, Name) :-
    (   foreign_library(Name, Needs)
    ->  format(string(Reason), "it needs ~w, which Mindstage does not use", [Needs])
    ;   Reason = "no package beside this file contains it, and SWI-Prolog does not have it"
    ),
    (   missing_library(Source, Name-_) -> true
    ;   assertz(missing_library(Source, Name-Reason)),
        print_message(warning, mindstage_missing_library(Name, Reason))
    ).

% -- ROS packages ------------------------------------------------------------------------------------------------------

% prolog_folder(+File, -Folder): the folder prolog/ of the package that a file is in.
prolog_folder(File, Folder) :-
    file_directory_name(File, Directory),
    (   file_base_name(Directory, prolog)
    ->  Folder = Directory
    ;   Directory \== File,
        file_directory_name(Directory, Above),
        Above \== Directory,
        prolog_folder(Directory, Folder)
    ).

% package_file(+Source, +Library, -File): in a registered package, in that of the source, or in one beside it.
package_file(Source, Name, File) :-
    atom_concat(Name, '.pl', Base),
    candidate_folder(Source, Folder),
    directory_file_path(Folder, Base, File),
    exists_file(File), !.

candidate_folder(_, Folder) :- package_folder(Folder, registered).
candidate_folder(Source, Folder) :- file_directory_name(Source, Folder).
candidate_folder(Source, Folder) :-
    prolog_folder(Source, Own),
    (   Folder = Own
    ;   file_directory_name(Own, Package),
        file_directory_name(Package, Stack),
        member(Pattern, ['/*/prolog', '/../*/*/prolog']),
        atom_concat(Stack, Pattern, Wild),
        expand_file_name(Wild, Folders),
        member(Folder, Folders)
    ).

%!  register_ros_package(+Package) is det.
%
%   Adds the folder prolog/ of a ROS package to the libraries, and loads its init.pl. The package is searched beside the file
%   that is being loaded and among the packages of the knowledge base. One that is not found is a warning.
register_ros_package(Package) :- register_ros_package(Package, _).

register_ros_package(Package, Folder) :-
    must_be(atom, Package),
    ( prolog_load_context(source, Source) -> true ; Source = '' ),
    (   ros_package_folder(Source, Package, Path)
    ->  directory_file_path(Path, prolog, Found),
        atom_concat(Found, /, Folder),
        register_folder(Source, Package, Found)
    ;   Folder = '',
        report_missing_package(Source, Package)
    ).

rospack_package_path(Package, Path) :-
    ( prolog_load_context(source, Source) -> true ; Source = '' ),
    ros_package_folder(Source, Package, Path).

use_ros_module(Package, File) :-
    register_ros_package(Package, Folder),
    atom_concat(Folder, File, Path),
    user:use_module(Path).

ros_package_path(Package, Path) :- rospack_package_path(Package, Path).

% use_directory(+Folder): of KnowRob 2: loads __init__.pl of a folder beside the file that is being loaded.
use_directory(Folder) :-
    prolog_load_context(directory, Directory),
    atomic_list_concat([Directory, Folder, '__init__.pl'], /, File),
    prolog_load_context(module, Module),
    Module:load_files(File, [if(not_loaded)]).

ros_package_folder(Source, Package, Path) :-
    candidate_folder(Source, Folder),
    file_directory_name(Folder, Path),
    file_base_name(Path, Package), !.
ros_package_folder(_, Package, Path) :-
    request(ros_package_folder(Package), Found),
    Found \== none,
    Path = Found.

register_folder(_, _, Folder) :- package_folder(Folder, registered), !.
register_folder(Source, _, Folder) :-
    assertz(package_folder(Folder, registered)),
    assertz(package_folder(Folder, by(Source))),
    assertz(user:file_search_path(ros, Folder)),
    directory_file_path(Folder, 'init.pl', Init),
    (   exists_file(Init), \+ same_file(Init, Source) -> user:load_files(Init, [if(not_loaded)]) ; true ).

report_missing_package(Source, Package) :-
    assertz(package_folder(Package, by(Source))),
    (   warned_package(Package) -> true
    ;   assertz(warned_package(Package)),
        print_message(warning, mindstage_missing_package(Package))
    ).

% -- errors while a file is loaded ------------------------------------------------------------------------------------

% A directive that calls a predicate of a missing library is a warning with the reason, since the rest of the file is loaded.
:- multifile user:message_hook/3.
:- dynamic user:message_hook/3.

user:message_hook(Message, error, _) :-
    mindstage_user_files:load_error(Message, Source, Error),
    mindstage_user_files:outside_reason(Error, Source, Warning),
    print_message(warning, Warning).

load_error(initialization_error(_, Error, Source:_), Source, Error) :- !.
load_error(Error, Source, Error) :- prolog_load_context(source, Source).

% outside_reason(+Error, +Source, -Warning): the error is about something outside of Prolog.
outside_reason(error(existence_error(procedure, Procedure), _), Source, mindstage_missing_predicate(Procedure, Reason)) :-
    missing_predicate(Source, Procedure, Reason).
outside_reason(error(shared_object(_, Message), _), Source, mindstage_missing_object(Message)) :-
    \+ of_swi_prolog(Source).

missing_predicate(_, Procedure, Reason) :-
    strip_module(Procedure, _, Name/_),
    atom_concat(jpl_, _, Name), !,
    foreign_library(jpl, Needs),
    format(string(Reason), "it needs ~w, which Mindstage does not use", [Needs]).
missing_predicate(Source, _, Reason) :-
    findall(Name, missing_library(Source, Name-_), Names),
    Names \== [], !,
    format(string(Reason), "it may be one of the libraries that are not loaded: ~w", [Names]).

% Rules of KnowRob 2 are clauses; what is told by +> and ?+> is listed by told_by/2.
:- multifile user:term_expansion/2, told_by/2.
:- dynamic user:term_expansion/2, told_by/2.

user:term_expansion((Head ?> Body), (Head :- Body)).
user:term_expansion((Head +> Body), mindstage_user_files:told_by(Head, Body)).
user:term_expansion((Head ?+> Body), [(Head :- Body), mindstage_user_files:told_by(Head, Body)]).

% A prefix may be registered by another file that is loaded later. Goals then keep the prefixed name, which the predicates of
% Mindstage expand when they are called.
:- wrap_predicate(rdf_prefixes:rdf_expand(Goal, _, Expanded, _), mindstage, Wrapped,
                  mindstage_user_files:expand_known(Wrapped, Goal, Expanded)).

expand_known(Wrapped, Goal, Expanded) :-
    catch(Wrapped, error(existence_error(rdf_prefix, Prefix), _), unknown_prefix(Prefix, Goal, Expanded)).

unknown_prefix(Prefix, Goal, Goal) :-
    (   warned_prefix(Prefix) -> true
    ;   assertz(warned_prefix(Prefix)),
        print_message(warning, mindstage_unknown_prefix(Prefix))
    ).

% -- module-qualified goals --------------------------------------------------------------------------------------------

% rdf_db:rdf_register_ns(...) and owl_parser:owl_parse(...) name modules of KnowRob's libraries. Goals in files of users that
% do so call the predicates of Mindstage, unless the user has a module of that name.
own_module(rdf_db).
own_module(rdfs).
own_module(owl).
own_module(t20_owl).
own_module(owl_parser).
own_module(rdfs_computable).
own_module(knowrob_owl).
own_module(rosprolog).

:- multifile system:goal_expansion/2.
:- dynamic system:goal_expansion/2.

system:goal_expansion(Goal, mindstage:Goal) :-
    prolog_load_context(module, Module),  % of a goal Module:Goal
    mindstage_user_files:own_module(Module),
    callable(Goal),
    mindstage_user_files:is_replaced_goal(Module, Goal).

is_replaced_goal(Module, Goal) :-
    (   prolog_load_context(source, Source) -> \+ of_swi_prolog(Source), \+ of_mindstage(Source) ; true ),
    \+ ( module_property(Module, file(File)), \+ of_swi_prolog(File) ),
    functor(Goal, Name, Arity),
    functor(General, Name, Arity),
    predicate_property(mindstage:General, defined),
    \+ predicate_property(mindstage:General, built_in).

of_mindstage(Source) :-
    module_property(mindstage_user_files, file(Own)),
    file_directory_name(Own, Folder),
    sub_atom(Source, 0, _, _, Folder).

% -- messages ----------------------------------------------------------------------------------------------------------

:- multifile prolog:message//1.

prolog:message(mindstage_missing_library(Name, Reason)) -->
    [ 'library(~q) is not loaded: ~w. Goals that call its predicates throw an error.'-[Name, Reason] ].
prolog:message(mindstage_missing_package(Package)) -->
    [ 'the ROS package ~q is neither beside this file nor among the packages of the knowledge base; '-[Package],
      'give its folder with --ontology, or put it beside the package of this file'-[] ].
prolog:message(mindstage_missing_predicate(Procedure, Reason)) -->
    [ '~q cannot be called: ~w'-[Procedure, Reason] ].
prolog:message(mindstage_missing_object(Message)) -->
    [ 'a library of machine code is not loaded, and its predicates are unknown: ~w'-[Message] ].
prolog:message(mindstage_unknown_prefix(Prefix)) -->
    [ 'the prefix ~q is unknown here; register it with rdf_register_prefix/2 before its names are used'-[Prefix] ].
prolog:message(mindstage_source_not_loaded(Source, Sentence)) --> [ '~w is not loaded: ~w'-[Source, Sentence] ].
